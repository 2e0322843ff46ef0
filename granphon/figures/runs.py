"""The runs of a figure of several: what each is, which quantities it holds, and their curves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

# before matplotlib, whose import this module guards
from granphon.figures.curves import Curve

# isort: split
import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief, message
from granphon.figures.fits import write_width
from granphon.figures.sweep_lines import describe_lines, find_load, list_parameters, read_curve
from granphon.figures.words import describe_medium, list_facts, write_value
from granphon.fits.fit import WidthFit
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates
from granphon.sweeps.dataset import find_dataset

if TYPE_CHECKING:
    from granphon.sweeps.dataset import Dataset


Array = NDArray[np.float64]
#: what may be on the axis of loads
LOADS_OF_AXES = ("force", "pressure", "overlap", "reduced_force")
#: number of forces at which the line of a fit is drawn
_LINE = 200


@dataclass(frozen=True, eq=False)
class Run:
    """One run: a data set of states, a fit, or of one state bands, a density of states or both.

    What it does not hold is None.

    ``name`` is that in messages; where ``named``, it also stands in legends, for all that the curves of the run share.
    """

    name: str
    dataset: Dataset | None = None
    fit: WidthFit | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    named: bool = False

    @classmethod
    def of(cls, name: str, result: Any, named: bool = False) -> Run:
        """Take a result of the library; :class:`~granphon.base.errors.InputError` for what shares no figure with others."""
        if isinstance(result, Run):
            return result
        if isinstance(result, WidthFit):
            return cls(name, fit=result, named=named)
        if isinstance(result, Bands):
            return cls(name, bands=result, named=named)
        if isinstance(result, DensityOfStates):
            return cls(name, dos=result, named=named)
        dataset = find_dataset(result)
        if dataset is not None:
            bands, dos = (getattr(result, one, None) for one in ("bands", "dos"))
            return cls(name, dataset=dataset, bands=bands, dos=dos, named=named)
        mend = "Give sweeps, fits, bands, densities of states, or results of scenes"
        raise InputError(message(f"{brief(result)} shares no figure with others", mend=mend))

    @property
    def what(self) -> str:
        """What the run holds, in words."""
        if self.fit is not None:
            return "a fit"
        held = [name for name, one in (("bands", self.bands), ("a density of states", self.dos)) if one is not None]
        if not held and self.dataset is not None:
            return "a sweep" if self.dataset["valid"].size > 1 else "a single state"
        return " and ".join(held)

    @property
    def load(self) -> str:
        """The load that was given: force, pressure or overlap."""
        if self.dataset is not None:
            return find_load(self.dataset)
        return "force"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that are one number at each load."""
        if self.dataset is not None:
            dims = {"load", "medium", *list_parameters(self.dataset)}
            return tuple(
                str(name)
                for name, values in self.dataset.variables.items()
                if "load" in values.dims and set(values.dims) <= dims and values.dtype.kind in "fiu"
            )
        if self.fit is not None:
            return (self.fit.waves.branch,)
        return ()

    @property
    def pressure_unit(self) -> str:
        """The SI unit of the pressure, which depends on the number of periods of the lattice; empty if it has none."""
        if self.dataset is not None:
            return str(self.dataset["pressure"].attrs.get("units", "")) if "pressure" in self.dataset else ""
        if self.fit is not None:
            return self.fit.packing.structure.units_of({"pressure"})["pressure"]
        return ""

    def find_loads(self, x: str) -> Array:
        """Return the loads ``x`` of all states of the run for a contact force of one newton, where they are in proportion.

        Empty for a run of bands alone.
        """
        if self.dataset is not None:
            return np.ravel(self.dataset[x] / self.dataset["force"]) if x in self.dataset else np.zeros(0)
        if self.fit is not None:
            return np.atleast_1d(self._convert(np.ones(1), x))
        return np.zeros(0)

    def find_curves(self, x: str, y: str) -> Iterable[Curve]:
        """Yield the curves of a quantity ``y`` over the load ``x``, both of which the run holds."""
        if self.dataset is not None:
            for name in (x, y):
                if not np.any(np.isfinite(self.dataset[name])):
                    why = "It is infinite for equal balls" if name == "reduced_force" else ""
                    raise InputError(message(f"{name} of {self.name} is nowhere finite", why, "Draw it over another load"))
            for facts, index in describe_lines(self.dataset, y):
                yield read_curve(self.dataset, y, x, index, self.name, self._add_name(facts))
        elif self.fit is not None:
            yield from self._find_fit(self.fit, x)

    def _add_name(self, facts: dict[str, str]) -> dict[str, str]:
        return {"name": self.name} | facts if self.named else facts

    def _convert(self, force: Array, x: str) -> Array:
        """Return another load of the fitted packing under contact forces, N."""
        assert self.fit is not None
        fit = self.fit
        if x == "overlap" and fit.choice.stand_in != fit.choice:
            why = "The overlap in a simulation is not in proportion to anything that was measured"
            raise InputError(message(f"the fit {self.name} has no overlaps", why, "Draw it over the force"))
        state = fit.choice.stand_in.of(fit.packing).at_force(force, finite_overlap=fit.waves.finite_overlap)
        return np.asarray(getattr(state, x), float)

    def _find_fit(self, fit: WidthFit, x: str) -> Iterable[Curve]:
        """Yield the measured velocities, and the line of the fit."""
        structure, facts = fit.packing.structure, list_facts(fit.packing, fit.waves.finite_overlap)
        if "width" in fit.parameters:
            facts["spread"] = f"fitted W = {write_width(fit)}"
        facts["medium"] = describe_medium(fit.medium, structure.periods, structure.n_balls)
        if fit.waves.frequency is not None:
            several = np.ndim(fit.waves.frequency) > 0
            facts["waves"] = "pulses" if several else f"pulses of {write_value(float(fit.waves.frequency), 'Hz')}"
        units = {"force": "N", "pressure": self.pressure_unit, "overlap": "m", "reduced_force": "1"}[x], "m/s"
        points = Curve.of_points(self.name, {}, self._convert(fit.force, x), fit.velocity, fit.sigma, units=units)
        yield replace(points, measured=True)
        several = np.ndim(fit.waves.frequency) > 0
        force = np.sort(fit.force) if several else np.geomspace(fit.force.min(), fit.force.max(), _LINE)
        velocity = fit.velocities[np.argsort(fit.force, kind="stable")] if several else fit.velocity_at(force)
        line = Curve.of_points(self.name, self._add_name(facts), self._convert(force, x), velocity, units=units)
        yield replace(line, simulated=np.full(force.shape, several))
