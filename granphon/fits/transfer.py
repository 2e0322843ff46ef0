"""Fit the damping of contacts to a measured transfer function: magnitude, and phase if it is known,
at given frequencies.

The model is the response of the network (:mod:`granphon.waves.response`). Where sigma is not given,
each complex value is taken to have the same relative error, so that the phase has it in radians; it
is found from the scatter. A resonance that is off by its width attracts nothing, so stiffnesses are
first searched with much damping, and then the damping; the best few are starting points of least
squares.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.quantities import FREQUENCY, Quantity
from granphon.base.results import Result
from granphon.base.tables import Table
from granphon.base.text import list_names, suggest
from granphon.base.validation import finite_list, texts
from granphon.dynamics.damping import ContactDamping
from granphon.fits.fit import LARGE_ERROR, SAME_EFFECT, Fitted, WidthFit, judge_residuals
from granphon.fits.velocity_model import require_fitted
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.response import QUANTITIES
from granphon.waves.waves import Waves

#: what may be fitted, and its unit; of stiffness, load and gain it is the ratio to those of the
#: network
PARAMETERS = {
    "damping": "s",
    "tangential_damping": "s",
    "loss_factor": "1",
    "tangential_loss_factor": "1",
    "stiffness": "1",
    "load": "1",
    "gain": "1",
}
#: loss factors from which the search starts
_LOSSES = np.geomspace(1e-3, 1.0, 10)
#: loss factor with which stiffnesses are searched
_BROAD = 0.1
#: least and largest loss factor up to which a loss that is nearly zero may err
_LEAST_LOSS = 1e-9
_LARGEST_LOSS = 10.0
#: ratios of the stiffness that are tried
_STIFFER = np.geomspace(0.5, 2.0, 57)
#: number of these ratios that are followed to a minimum
_FOLLOWED = 3
#: factors that convert the numbers of a table into 1 or radians
_NUMBERS = {"": 1.0, "1": 1.0, "%": 0.01}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}
#: columns of a table
_COLUMNS = ("frequency", "magnitude", "phase", "sigma", "phase_sigma")
_MAGNITUDES = {
    "displacement": Quantity("receptance", "m/N", "2 um/N", "m/N, um/N, nm/N"),
    "velocity": Quantity("mobility", "m/s/N", "2 mm/s/N", "m/s/N, mm/s/N"),
}


@dataclass(frozen=True, eq=False, repr=False)
class TransferFunction(Result):
    """A measured transfer function.

    Attributes
    ----------
    frequencies : (n,) Hz, above zero, in any order.
    magnitude : (n,) m/N, m/(N s) or 1, above zero.
    phase : (n,) rad, below zero where the receiver lags; None if it is not known.
    sigma, phase_sigma : (n,) standard errors of magnitude and phase; None if they are not known.
        Where that of the phase alone is not, it is that of the magnitude over the magnitude.

    Raises :class:`~granphon.base.errors.InputError` for numbers that are not finite, not above zero
    (but for the phase), or not as many as the frequencies; and for a phase_sigma without phase or
    sigma.
    """

    frequencies: Annotated[Array, "n", "Hz"]
    magnitude: Annotated[Array, "n"]
    phase: Annotated[Array | None, "n?", "rad"] = None
    sigma: Annotated[Array | None, "n?"] = None
    phase_sigma: Annotated[Array | None, "n?", "rad"] = None

    def __post_init__(self) -> None:
        for name in self._shapes:
            values: Any = getattr(self, name)
            if values is None:
                continue
            numbers = np.array(
                finite_list(
                    name, values, self.units.get(name, ""), "" if name == "phase" else "above zero"
                )
            )
            if numbers.shape != np.shape(self.frequencies):
                fault = (
                    f"there are {numbers.size} numbers of {name}, and {np.size(self.frequencies)}"
                    f" frequencies"
                )
                raise InputError(fault, mend="Give the same number of each")
            object.__setattr__(self, name, numbers)
        if self.phase_sigma is not None and (self.phase is None or self.sigma is None):
            lacks = "phase" if self.phase is None else "sigma of the magnitude"
            raise InputError(
                f"phase_sigma is given, and no {lacks}", mend="Give both, or leave phase_sigma out"
            )
        super().__post_init__()

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        columns: Mapping[str, str] | None = None,
        quantity: str = "displacement",
    ) -> Self:
        """Read a table with a heading for each column, such as ``frequency (Hz),magnitude
        (um/N),phase (deg)``.

        Parameters
        ----------
        path : a file with the columns frequency and magnitude and, where known, phase (rad or deg),
            sigma and phase_sigma. A magnitude may be in dB; sigma in the unit of the magnitude, in
            dB, or in % of it.
        columns : headings of columns that go by other names, perhaps with a unit: {"magnitude": "H1
            (um/N)"}.
        quantity : "displacement", magnitudes in m/N; "velocity", in m/s/N; or "transmissibility",
            numbers.

        Raises :class:`~granphon.base.errors.InputError` for a file, line or cell that cannot be
        read, a column that is missing or has another unit, and what the constructor refuses.
        """
        table = Table.read(path)
        named = dict(columns or {})
        unknown = [name for name in named if name not in _COLUMNS]
        if unknown:
            fault = f"{unknown[0]!r} is not a kind of column of a transfer function"
            raise InputError(fault, mend=suggest(unknown[0], _COLUMNS))
        heads = {kind: named.get(kind, kind) for kind in _COLUMNS}
        for kind in _COLUMNS[:2]:
            if heads[kind] not in table:
                fault = f"{table.name} has no column named {heads[kind]!r}"
                why = (
                    f"Its columns are"
                    f" {list_names(repr(str(heading)) for heading in table.headings)}"
                )
                mend = (
                    f"Head it '{kind}', or name it: --column '{kind}=NAME', columns={{'{kind}':"
                    f" 'NAME'}}"
                )
                raise InputError(fault, why, mend)

        def read(kind: str, factors: Mapping[str, float]) -> Array | None:
            """Return the numbers of a column in one of these units; None if it is not there, or has
            another unit.
            """
            unit = table.unit(heads[kind])
            if heads[kind] not in table or unit not in factors:
                return None
            try:
                return factors[unit] * table.numbers(heads[kind])
            except InputError as error:
                raise InputError(f"{table.name}, {error}") from None

        def measure(kind: str) -> Array:
            unit = _MAGNITUDES.get(quantity)
            values = read(kind, {} if unit else _NUMBERS)
            if unit and table.unit(heads[kind]) in _NUMBERS:
                fault = f"{table.name}: the column {heads[kind]!r} has no unit of {unit.name}"
                mend = (
                    f"Head it '{kind} ({unit.unit})'; or if it is a transmissibility, give"
                    f" quantity='transmissibility'"
                )
                raise InputError(fault, mend=f"{mend} (in a scene, response.quantity)")
            if values is None and unit:
                return table.column(heads[kind], unit)
            if values is None:
                fault = (
                    f"{table.name}: the column {heads[kind]!r} has the unit"
                    f" {table.unit(heads[kind])!r}"
                )
                raise InputError(
                    fault, "A transmissibility is a number", "Leave the unit out, or use % or dB"
                )
            return values

        decibels = read("magnitude", {"dB": 1.0})
        magnitude = measure("magnitude") if decibels is None else 10.0 ** (decibels / 20.0)
        sigma: Array | None = None
        if heads["sigma"] in table:
            percents = read("sigma", {"%": 0.01})
            decibel_error = read("sigma", {"dB": math.log(10.0) / 20.0})
            relative = decibel_error if percents is None else percents
            sigma = measure("sigma") if relative is None else relative * magnitude
        angles = []
        for kind in ("phase", "phase_sigma"):
            angle = read(kind, _ANGLES)
            if angle is None and heads[kind] in table:
                fault = f"{table.name}: the column {heads[kind]!r} is not in rad or deg"
                raise InputError(fault, mend=f"Head it '{kind} (rad)'")
            angles.append(angle)
        frequencies = table.column(heads["frequency"], FREQUENCY)
        try:
            return cls(frequencies, magnitude, angles[0], sigma, angles[1])
        except InputError as error:
            raise InputError(f"{table.name}: {error}") from None


@dataclass(frozen=True)
class _Model:
    """The transfer function of a network at (n,) frequencies, as a function of the parameters
    (p,).
    """

    network: ContactNetwork
    names: tuple[str, ...]
    damping: tuple[Any, Any]
    loss_factor: tuple[Any, Any]
    frequencies: Array
    places: dict[str, Any]

    def losses(self, values: Mapping[str, float]) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Return (normal, tangential) damping and loss factor; the tangential value is the normal
        one unless it is fitted.
        """

        def find_pair(name: str, fixed: tuple[Any, Any]) -> tuple[Any, Any]:
            normal = values.get(name, fixed[0])
            default = normal if name in values else fixed[1]
            return normal, values.get(f"tangential_{name}", default)

        return find_pair("damping", self.damping), find_pair("loss_factor", self.loss_factor)

    def __call__(self, parameters: Array) -> NDArray[np.complex128]:
        values = dict(zip(self.names, parameters.tolist(), strict=True))
        network = self.network
        load = values.get("load", 1.0)
        under_load = hertz.stiffness_under(load)
        stiffer = values.get("stiffness", 1.0) * under_load / hertz.stiffness_under(1.0)
        scaled = {
            "normal_stiffness": stiffer * network.normal_stiffness,
            "shear_stiffness": stiffer * network.shear_stiffness,
            "torsion_stiffness": stiffer * network.torsion_stiffness,
            "bending_stiffness": stiffer * network.bending_stiffness,
            "normal_force": load * network.normal_force,
        }
        if network.tangential_force is not None:
            scaled["tangential_force"] = load * network.tangential_force
        frequencies, inverse = np.unique(self.frequencies, return_inverse=True)
        damping, losses = self.losses(values)
        response = Waves(replace(network, **scaled)).response(
            frequencies, damping=damping, loss_factor=losses, **self.places
        )
        return np.asarray(values.get("gain", 1.0) * response.coherent[inverse])


@dataclass(frozen=True, eq=False, repr=False)
class DampingFit(Fitted):
    """Parameters of a network whose response fits a measured transfer function, and how well they
    are known.

    Attributes
    ----------
    parameters, values : names (p,) and SI values (p,) of the fitted parameters: damping and
        tangential_damping, s; loss_factor and tangential_loss_factor; stiffness, load and gain,
        ratios to those of the network.
    covariance : covariance (p, p) of their errors, SI.
    damping, loss_factor : (2,) of normal and of all other motion, s and 1, as ``Waves.response``
        takes them.
    measured : the data; its sigmas are as given, or from the scatter.
    quantity : of the data, as for ``Waves.response``.
    sigma_given : whether sigma was given.
    magnitude, phase : (n,) of the fit at the data, in the unit of the data, and rad.
    chi2 : sum of the squares of residuals over sigma, which equals ``dof`` where sigma is from the
        scatter.
    dof : degrees of freedom.
    warnings : reasons not to trust the fit.
    """

    units: ClassVar[dict[str, str]] = {"damping": "s", "loss_factor": "1", "phase": "rad"}
    _notebook_fields = ("stderrs",)
    _units_of_parameters = PARAMETERS

    parameters: Annotated[tuple[str, ...], "p"]
    values: Annotated[Array, "p"]
    covariance: Annotated[Array, "p p"]
    damping: Annotated[Array, "2"]
    loss_factor: Annotated[Array, "2"]
    measured: TransferFunction
    quantity: str
    sigma_given: bool
    magnitude: Annotated[Array, "n"]
    phase: Annotated[Array, "n"]
    chi2: float
    dof: int
    warnings: tuple[str, ...]

    def _field_units(self) -> dict[str, str]:
        return super()._field_units() | {"magnitude": QUANTITIES[self.quantity]}

    def _list_columns(self) -> dict[str, Any]:
        data = self.measured
        unit = QUANTITIES[self.quantity]
        columns: dict[str, Any] = {
            "frequency (Hz)": data.frequencies,
            f"magnitude ({unit})": data.magnitude,
            f"sigma ({unit})": data.sigma,
            f"fit ({unit})": self.magnitude,
            "fitted phase (rad)": self.phase,
        }
        if data.phase is not None:
            columns |= {"phase (rad)": data.phase, "phase_sigma (rad)": data.phase_sigma}
        return columns


def read_fit(data: Any) -> WidthFit | DampingFit:
    """Build a fit of either kind from what stands in its fit.yaml."""
    is_damping = isinstance(data, Mapping) and data.get("class") == DampingFit.__name__
    return DampingFit.from_dict(data) if is_damping else WidthFit.from_dict(data)


def find_secant(
    compare: Callable[[Array], Array], values: Array, index: int, scatter: float, name: str
) -> Array:
    """Return the change of the residuals over that of one loss, between its best value and the
    value at which the residuals have changed by their scatter.

    Magnitudes depend on a loss that is nearly zero by its square only, so that the derivative there
    says nothing of the error: the loss up to which the misfit rises by that of one standard
    deviation does. ``values`` are in units of a typical value, ``index`` says which is the loss.

    Raises :class:`~granphon.base.errors.InputError` if no loss changes the residuals so much.
    """
    from scipy.optimize import brentq

    start = compare(values)

    def change(step: float) -> Array:
        return compare(values + step * (np.arange(values.size) == index)) - start

    def rise(logarithm: float) -> float:
        return float(np.linalg.norm(change(math.exp(logarithm)))) - scatter

    logarithm = math.log(_LEAST_LOSS)
    while rise(logarithm) < 0.0:
        logarithm += math.log(2.0)
        if logarithm > math.log(_LARGEST_LOSS):
            raise InputError(f"the data say nothing of {name}", mend="Measure nearer to resonances")
    if logarithm > math.log(_LEAST_LOSS):
        logarithm = brentq(rise, logarithm - math.log(2.0), logarithm, xtol=1e-3)
    step = math.exp(logarithm)
    return change(step) / step


def fit_damping(
    x: Any,
    measured: TransferFunction,
    source: Any,
    receiver: Any,
    *,
    parameters: Sequence[str] = ("damping",),
    damping: Any = 0.0,
    loss_factor: Any = 0.0,
    quantity: str = "displacement",
    direction: ArrayLike | None = None,
    polarisation: str | ArrayLike = "longitudinal",
    distance: float | None = None,
) -> DampingFit:
    """Find the damping of contacts at which the response of a network is a measured transfer
    function.

    Parameters
    ----------
    x : a state, a sample or a network, as for :class:`granphon.Waves`, finite or cut as in the
        experiment.
    measured : the transfer function, :class:`TransferFunction`.
    source, receiver, quantity, direction, polarisation, distance : as for
    :meth:`granphon.Waves.response`; of several
        receivers, those of a plane say, the mean is compared.
    parameters : one or more of "damping", s; "loss_factor"; "tangential_damping" and
        "tangential_loss_factor", of slip, twist and rolling, which are otherwise those of normal
        motion; "stiffness", by which all stiffnesses are multiplied; "load", by which static forces
        are, and stiffnesses by its cubic root, as in Hertz's law; and "gain", by which the whole
        response is, where sensors are not calibrated.
    damping, loss_factor : s and 1, numbers, or tuples of those of normal and of all other motion,
        which are not fitted.

    Returns
    -------
    :class:`DampingFit`. Standard errors are those of linear theory, from the given sigma or from
    the scatter. A loss whose error exceeds its value has the error up to which the misfit rises by
    that of one standard deviation.

    Raises :class:`~granphon.base.errors.InputError` for parameters that cannot be fitted or told
    apart, too few data, losses of which the data say nothing, and what
    :meth:`granphon.Waves.response` refuses.
    """
    from scipy.optimize import least_squares

    if not isinstance(measured, TransferFunction):
        raise InputError(
            "the data are no transfer function",
            mend="Give a gp.TransferFunction(frequencies, magnitude)",
        )
    names = texts("parameters", parameters)
    require_fitted(names, PARAMETERS)
    network = given_network(x)
    if {"stiffness", "load"} <= set(names) and not network.prestress:
        why = "Without prestress a load does no more than scale stiffnesses"
        raise InputError("the data cannot tell stiffness and load apart", why, "Fit one of them")
    # wrong values are refused before the fit
    given_damping = ContactDamping.of(network, damping, loss_factor)
    fixed_damping = damping if isinstance(damping, tuple) else (damping, damping)
    fixed_loss = loss_factor if isinstance(loss_factor, tuple) else (loss_factor, loss_factor)
    places = {
        "source": source,
        "receiver": receiver,
        "quantity": quantity,
        "direction": direction,
        "polarisation": polarisation,
        "distance": distance,
    }
    model = _Model(
        network,
        names,
        (fixed_damping[0], fixed_damping[1]),
        (fixed_loss[0], fixed_loss[1]),
        measured.frequencies,
        places,
    )
    m = measured.magnitude
    phase = measured.phase
    sigma_given = measured.sigma is not None
    dof = m.size * (1 if phase is None else 2) - len(names)
    if dof < (not sigma_given):
        why = "" if sigma_given else "Without sigma one more is needed, to find the scatter"
        fault = (
            f"there are {dof + len(names)} numbers, to which {len(names)} parameters cannot be"
            f" fitted"
        )
        raise InputError(fault, why, "Measure more")
    sigma = m if measured.sigma is None else measured.sigma
    angle = sigma / m if measured.phase_sigma is None else measured.phase_sigma
    turned = np.ones(m.size) if phase is None else np.exp(1j * phase)

    # parameters are fitted in units of a typical value
    middle = 2.0 * math.pi * float(np.median(measured.frequencies))
    scale = np.array([{"s": 1.0 / middle}.get(PARAMETERS[name], 1.0) for name in names])
    is_loss = np.array([name not in ("stiffness", "load", "gain") for name in names])

    @lru_cache(maxsize=16)
    def respond_without_gain(values: tuple[float, ...]) -> NDArray[np.complex128]:
        return model(np.array(values))

    def respond(values: tuple[float, ...]) -> NDArray[np.complex128]:
        """Return the transfer function; the network is not solved anew for another gain."""
        if "gain" not in names:
            return respond_without_gain(values)
        place = names.index("gain")
        others = (*values[:place], 1.0, *values[place + 1 :])
        return np.asarray(values[place] * respond_without_gain(others))

    def compare(scaled: Array) -> Array:
        """Return the residuals of magnitudes, and of phases if they are known, over sigma."""
        h = respond(tuple((scaled * scale).tolist()))
        residuals = (m - np.abs(h)) / sigma
        if phase is None:
            return np.asarray(residuals)
        return np.concatenate([residuals, np.angle(turned / h) / angle])

    def compare_logarithms(scaled: Array) -> Array:
        """Return the differences of logarithms of magnitudes, and of phases if they are known."""
        h = respond(tuple((scaled * scale).tolist()))
        with np.errstate(divide="ignore"):
            differences = np.log(m / np.abs(h))
        if phase is None:
            return np.asarray(differences)
        return np.concatenate([differences, np.angle(turned / h)])

    def start(loss: float, stiffer: float = 1.0) -> tuple[float, Array]:
        """Return the misfit of logarithms, and parameters, with the gain that fits best."""
        scaled = np.where(is_loss, loss / max(int(np.sum(is_loss)), 1), 1.0)
        for name, value in (("stiffness", stiffer), ("load", stiffer**3)):
            if name in names:
                scaled[names.index(name)] = value
        differences = compare_logarithms(scaled)
        if "gain" in names:
            scaled[names.index("gain")] = math.exp(float(np.mean(differences[: m.size])))
            differences = compare_logarithms(scaled)
        return float(differences @ differences), scaled

    ratios = [1.0]
    is_searched = bool({"stiffness", "load"} & set(names))
    if is_searched:
        misfits = sorted((start(_BROAD, ratio)[0], ratio) for ratio in _STIFFER.tolist())
        ratios = [ratio for _, ratio in misfits[:_FOLLOWED]]
    losses = _LOSSES.tolist() if np.any(is_loss) else [0.0]
    starts = sorted(
        (start(loss, ratio) for ratio in ratios for loss in losses),
        key=lambda misfit_and_parameters: misfit_and_parameters[0],
    )
    low = np.where(is_loss, 0.0, 1e-3)
    limits = (low, np.full(low.shape, np.inf))
    fits = [
        least_squares(
            compare,
            first,
            "3-point",
            limits,
            x_scale=np.maximum(first, 1e-3),
            ftol=1e-13,
            xtol=1e-13,
            gtol=1e-13,
        )
        for _, first in starts[: _FOLLOWED if is_searched else 1]
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    h = respond(tuple((best.x * scale).tolist()))
    chi2 = 2.0 * float(best.cost)
    scatter = 1.0 if sigma_given else max(math.sqrt(chi2 / dof), float(np.finfo(float).eps))
    jacobian = np.array(best.jac)
    least = np.linalg.norm(jacobian, axis=0) * best.x
    for index in np.flatnonzero(is_loss & (least < scatter)).tolist():
        jacobian[:, index] = find_secant(compare, best.x, index, scatter, names[index])
    norms = np.linalg.norm(jacobian, axis=0)
    _, singular, right = np.linalg.svd(jacobian / np.maximum(norms, 1e-300), full_matrices=False)
    if np.any(norms == 0.0) or singular[-1] < SAME_EFFECT * singular[0]:
        fault = f"the data cannot tell {' and '.join(names)} apart"
        raise InputError(fault, mend="Measure a wider range, or fit fewer parameters")
    root = (right / singular[:, None]).T / norms[:, None] * scale[:, None] * scatter
    covariance = root @ root.T
    values = best.x * scale
    warnings = list(given_damping.find_warnings(float(np.max(measured.frequencies))))
    warnings += judge_residuals(chi2, dof, len(names)) if sigma_given or not dof else []
    warnings += [
        f"the standard error of {name} is {error:.2g}, and its value {value:.2g}: it can"
        f" hardly be told from zero"
        for name, value, error in zip(
            names, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True
        )
        if error > LARGE_ERROR * value
    ]
    pairs = model.losses(dict(zip(names, values.tolist(), strict=True)))
    mean_damping, mean_loss_factor = (
        np.array([float(np.mean(of_contacts)) for of_contacts in pair]) for pair in pairs
    )
    with_errors = replace(
        measured, sigma=sigma * scatter, phase_sigma=None if phase is None else angle * scatter
    )
    phases = np.angle(h) if phase is None else phase - np.angle(turned / h)
    return DampingFit(
        names,
        values,
        covariance,
        mean_damping,
        mean_loss_factor,
        with_errors,
        quantity,
        sigma_given,
        np.abs(h),
        phases,
        chi2 if sigma_given else float(dof),
        dof,
        tuple(warnings),
    )
