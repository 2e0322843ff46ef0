"""From a load to the stiffness of the contacts.

A medium turns a packing and a load into a :class:`ContactState`. Equal balls need only the averaged lattice
(equations 23 and 24), which is then exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.contact import HertzLaw
from granphon.errors import InputError, message
from granphon.packing import Packing
from granphon.results import Result
from granphon.units import Units

__all__ = ["AveragedLattice", "ContactState", "Medium"]

Array = NDArray[np.float64]
#: scalar in, scalar out; array in, array out
Values = Any


@dataclass(frozen=True, eq=False, repr=False)
class ContactState(Result):
    """The contacts of a packing under load. Every attribute has the shape of the load.

    Attributes
    ----------
    packing, medium, law : where the state comes from: the packing, the medium's name and its contact law.
    force : f, mean contact force, N.
    overlap : delta = d - a, m. The state variable: the spacing a would lose every digit of it.
    normal_stiffness : k = df/d(delta), N/m.
    finite_overlap : whether the boundary follows the balls, so that pressure and density are those at spacing d - delta.
    """

    units = {
        "force": "N", "overlap": "m", "normal_stiffness": "N/m", "shear_stiffness": "N/m", "pressure": "N/m",
        "reduced_force": "1", "reduced_spacing": "1", "force_fluctuation": "1", "contact_fraction": "1",
    }  # fmt: skip

    packing: Packing
    medium: str
    law: HertzLaw = field(repr=False)
    force: Values
    overlap: Values
    normal_stiffness: Values
    finite_overlap: bool = False

    def __getitem__(self, index: Any) -> ContactState:
        """The state at some of the loads, as arrays are indexed."""
        force, overlap, stiffness = (np.asarray(x)[index] for x in (self.force, self.overlap, self.normal_stiffness))
        return ContactState(self.packing, self.medium, self.law, force, overlap, stiffness, self.finite_overlap)

    @property
    def shear_stiffness(self) -> Values:
        """kappa = eta k, N/m (equation 4); zero without friction."""
        return self.packing.mindlin_ratio * self.normal_stiffness

    @property
    def pressure(self) -> Values:
        """P, force per length of boundary, N/m: sqrt(3) f / d on the triangular lattice (equation 20).

        With finite overlap sqrt(3) f / a. :class:`~granphon.errors.InputError` if the lattice's stress is no pressure.
        """
        return self.packing.structure.pressure_factor * self.force / (self.packing.diameter * self._shrinkage)

    @property
    def effective_density(self) -> Values:
        """rho~ of the layer taken one diameter thick, kg/m^3; with finite overlap at the spacing a."""
        return self.packing.effective_density / self._shrinkage**2

    @property
    def _shrinkage(self) -> Values:
        """a/d where the boundary follows the balls, else one."""
        return 1.0 - self.relative_overlap if self.finite_overlap else self._constant(1.0)

    @property
    def relative_overlap(self) -> Values:
        """delta / d."""
        return self.overlap / self.packing.diameter

    @property
    def reduced_force(self) -> Values:
        """f* of Section IV, f in units of the force at an overlap of the width; +inf for equal balls."""
        return self._constant(np.inf)

    @property
    def reduced_spacing(self) -> Values:
        """a* of Section IV, (d + W/2 - a)/W; +inf for equal balls."""
        return self._constant(np.inf)

    @property
    def force_fluctuation(self) -> Values:
        """rms contact force over the mean, Delta f / f; 0 for equal balls."""
        return self._constant(0.0)

    @property
    def contact_fraction(self) -> Values:
        """N_c / 6, the fraction of contacts that carry load; 1 for equal balls."""
        return self._constant(1.0)

    @property
    def valid(self) -> Values:
        """Whether the load is inside the medium's range; always, for equal balls."""
        return self._constant(True)

    @property
    def regime(self) -> Values:
        """Pressure regime of Section III ("low", "intermediate", "high"); equal balls are in the last."""
        return self._constant("high")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the load; () for a single one."""
        return np.shape(self.force)

    @property
    def is_single(self) -> bool:
        """Whether this is the state at one load."""
        return self.shape == ()

    @property
    def scales(self) -> Units:
        """The scales of reduced units at this load; :class:`~granphon.errors.InputError` for several loads."""
        if not self.is_single:
            raise InputError(
                message(
                    f"the state holds {int(np.size(self.force))} loads",
                    "Atoms, force constants and phonons belong to one",
                    "Call medium.at_force with one number",
                )
            )
        return Units(self.packing.diameter, self.normal_stiffness, self.packing.mass)

    def _constant(self, value: Any) -> Values:
        return np.full(self.shape, value) if self.shape else value


@runtime_checkable
class Medium(Protocol):
    """What every rung of the accuracy ladder offers: the state of a packing at a given load."""

    @property
    def packing(self) -> Packing:
        """The balls under load."""
        ...

    def at_force(self, force: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the mean contact force f, N."""
        ...

    def at_pressure(self, pressure: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the linear pressure P, N/m, on a boundary that shrinks with the balls if ``finite_overlap``."""
        ...

    def at_overlap(self, overlap: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the overlap delta = d - a, m."""
        ...


@dataclass(frozen=True)
class AveragedLattice:
    """Balls of the mean diameter on the lattice: f = (2/3) E* d^(1/2) delta^(3/2) (equation 23).

    Exact for equal balls. ``at_*`` take scalars or arrays and raise :class:`~granphon.errors.InputError` for a load
    that is not finite, tensile or zero, or that presses balls together by their whole diameter. With ``finite_overlap`` the
    state's pressure and density are those of a boundary that follows the balls.
    """

    packing: Packing

    def at_force(self, force: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the contact force f, N."""
        load = _loads("force", force)
        law = self.packing.law
        return self._state(load, law.overlap(load), "force", force, finite_overlap)

    def at_overlap(self, overlap: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the overlap delta = d - a, m."""
        delta = _loads("overlap", overlap)
        with np.errstate(over="ignore"):  # an overlap that large is refused below
            force = self.packing.law.force(delta)
        return self._state(force, delta, "overlap", overlap, finite_overlap)

    def at_pressure(self, pressure: ArrayLike, finite_overlap: bool = False) -> ContactState:
        """State at the force per length P, N/m: P d = sqrt(3) f on the triangular lattice (equation 20).

        With ``finite_overlap`` the boundary shrinks with the balls: P a = sqrt(3) f.
        """
        load = _loads("pressure", pressure)
        packing, law = self.packing, self.packing.law
        force = load * (packing.diameter / packing.structure.pressure_factor)
        if finite_overlap:
            # x = (delta/d)^(1/2) solves x^3 = y^3 (1 - x^2), with y its value at a fixed boundary. The left side over
            # the right rises monotonically, and Newton from y, which is too large, comes down to the root.
            y = np.sqrt(law.overlap(force) / packing.diameter)
            x = np.array(np.minimum(y, 1.0))
            for _ in range(100):
                step = (x**3 - y**3 * (1.0 - x) * (1.0 + x)) / (3.0 * x**2 + 2.0 * y**3 * x)
                x = x - step
                if np.all(np.abs(step) <= 4e-16 * x):
                    break
            return self._state(force * ((1.0 - x) * (1.0 + x)), packing.diameter * x**2, "pressure", pressure, True)
        return self._state(force, law.overlap(force), "pressure", pressure, False)

    def _state(self, force: Values, overlap: Values, name: str, given: ArrayLike, finite: bool) -> ContactState:
        law, diameter = self.packing.law, self.packing.diameter
        stiffness = law.stiffness(overlap)
        if not (np.all(force > 0.0) and np.all(stiffness > 0.0) and np.all(np.isfinite(force))):
            raise InputError(message(f"{name} = {given!r} is too small or too large for double precision"))
        if np.any(overlap >= diameter):
            raise InputError(
                message(
                    f"{name} = {given!r} presses the balls together by {float(np.max(overlap / diameter)):.4g} diameters",
                    "Balls cannot overlap by their diameter or more, and the contact law fails long before",
                    "Lower the load",
                )
            )
        return ContactState(self.packing, "ala", law, force[()], overlap[()], stiffness, finite)


def _loads(name: str, values: ArrayLike) -> Array:
    try:
        given = np.asarray(values)
        array = np.asarray(given, dtype=float) if given.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        array = None
    if array is None or isinstance(values, np.ma.MaskedArray):
        raise InputError(message(f"{name} is {values!r}", "It must be a real number or an array of them"))
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(message(f"{name} is {values!r}", "Every load must be a finite number"))
    if np.any(array < 0.0):
        raise InputError(
            message(f"{name} is {values!r}: tensile", "One-sided contacts carry no tension", "Give a load above zero")
        )
    if np.any(array == 0.0):
        raise InputError(
            message(f"{name} is zero", "Balls that only touch have no stiffness, and carry no sound", "Press them")
        )
    return array
