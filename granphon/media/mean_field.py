"""From a load to the stiffness of the contacts.

A medium turns a packing and a load into a :class:`ContactState`: the accuracy ladder of Section III, from the averaged
lattice (equations 23 and 24) by the averaged force (25) to the effective medium (28-46). They differ in their contact law
alone; for equal balls all are the averaged lattice, which is then exact.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import TRIANGULAR
from granphon.balls.material import LEAST_YOUNG_MODULUS
from granphon.balls.packing import Packing
from granphon.base.arguments import real_array
from granphon.base.errors import InputError, brief, message
from granphon.dynamics.local_field import LocalField, local_field, paper_local_field
from granphon.laws.effective import EffectiveLaw
from granphon.laws.spread import AveragedLaw
from granphon.media.state import ContactState, Law, overlap_flag

__all__ = ["AveragedForce", "AveragedLattice", "EffectiveMedium", "Medium"]

Array = NDArray[np.float64]
#: a number below the least normal one has lost digits
_LEAST = np.finfo(float).tiny


@runtime_checkable
class Medium(Protocol):
    """What every rung of the accuracy ladder offers: the state of a packing at a given load.

    ``finite_overlap`` is said here and read from the state ever after; None leaves the terms of relative order delta/d out.
    """

    @property
    def packing(self) -> Packing:
        """The balls under load."""
        ...

    def at_force(self, force: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the mean contact force f, N."""
        ...

    def at_pressure(self, pressure: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the linear pressure P, N/m, on a boundary that shrinks with the balls if ``finite_overlap``."""
        ...

    def at_overlap(self, overlap: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the overlap delta = d - a, m."""
        ...


@dataclass(frozen=True)
class _ByLaw(ABC):
    """A medium that is a contact law: ``at_*`` take scalars or arrays, in SI.

    They raise :class:`~granphon.base.errors.InputError` for a load that is not finite, not compressive, or presses balls
    together by their whole diameter, and :class:`~granphon.base.errors.PrecisionError` for one so low that the law is not
    known there. With ``finite_overlap`` all that is found of the state keeps the terms of relative order delta/d, and its
    pressure and density are those of a boundary that follows the balls.
    """

    name: ClassVar[str]
    #: the options of the medium, each with its words, the default first
    options: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    packing: Packing

    @cached_property
    def law(self) -> Law:
        """The medium's contact law; Hertz's for equal balls, in every medium."""
        return self._law if self.packing.width else self.packing.law

    @property
    @abstractmethod
    def _law(self) -> Law:
        """The law of balls that differ."""

    def __post_init__(self) -> None:
        if not isinstance(self.packing, Packing):
            raise InputError(message(f"packing is {self.packing!r}", mend="Give a granphon.Packing"))

    def at_force(self, force: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the mean contact force f, N."""
        load = compressive("force", force)
        with np.errstate(all="ignore"):  # whatever is beyond double precision is refused below
            overlap = np.asarray(self.law.overlap(load))
        return self._state(load, overlap, "force", force, finite_overlap)

    def at_overlap(self, overlap: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the overlap delta = d - a, m; where balls differ it may be negative, as long as some touch."""
        law = self.law
        delta = compressive("overlap", overlap) if law.least_overlap == 0.0 else finite("overlap", overlap)
        if np.any(delta <= law.least_overlap):
            raise untouched(overlap, -law.least_overlap)
        with np.errstate(all="ignore"):
            force = np.asarray(law.force(delta))
        return self._state(force, delta, "overlap", overlap, finite_overlap)

    def at_pressure(self, pressure: ArrayLike, *, finite_overlap: bool | None = None) -> ContactState:
        """State at the force per length P, N/m: P d = sqrt(3) f on the triangular lattice (equation 20).

        With ``finite_overlap`` the boundary shrinks with the balls: P a = sqrt(3) f.
        """
        load, law, d = compressive("pressure", pressure), self.law, self.packing.diameter
        follows, _ = overlap_flag(finite_overlap)
        with np.errstate(all="ignore"):
            slope = load / self.packing.structure.pressure_factor  # of the force in the spacing
            force = slope * d
            delta = np.asarray(law.overlap(force))
            # f(delta) = slope (d - delta). The left side rises and is convex: Newton from an overlap too large comes down.
            for _ in range(100 if follows else 0):
                step = (law.force(delta) - slope * (d - delta)) / (law.stiffness(delta) + slope)
                delta = delta - step
                if np.all(np.abs(step) <= 4e-16 * np.abs(delta)):
                    break
            if follows:
                force = np.asarray(law.force(delta))
        return self._state(force, delta, "pressure", pressure, finite_overlap)

    def _state(self, force: Array, overlap: Array, name: str, given: ArrayLike, finite_overlap: bool | None) -> ContactState:
        law, diameter = self.law, self.packing.diameter
        follows, said = overlap_flag(finite_overlap)
        with np.errstate(all="ignore"):
            stiffness = np.asarray(law.stiffness(overlap))
            length = np.maximum(np.abs(overlap), self.packing.width)
            # and what observables make of them: slope of the stiffness, pressure, modulus
            made = [force, stiffness, length, stiffness / length, force / diameter, stiffness / diameter]
        if not all(np.all((values >= _LEAST) & (values < np.inf)) for values in made):
            raise InputError(message(f"{name} = {given!r} is too small or too large for double precision"))
        if np.any(overlap >= diameter):
            what = f"{name} = {given!r} presses the balls together by {float(np.max(overlap / diameter)):.4g} diameters"
            why, mend = (
                "Balls cannot overlap by their diameter or more, and the contact law fails long before",
                "Lower the load",
            )
            modulus = self.packing.material.young_modulus
            if modulus < LEAST_YOUNG_MODULUS:
                why += f". The Young modulus is {modulus:g} Pa, probably a wrong unit, such as GPa given for Pa"
                mend = "Give the Young modulus in Pa (70 GPa are 70e9), or lower the load"
            raise InputError(message(what, why, mend))
        return ContactState(
            self.packing, self.name, law, force[()], overlap[()], stiffness[()], follows, overlap_given=said
        )  # fmt: skip


@dataclass(frozen=True)
class AveragedLattice(_ByLaw):
    """Balls of the mean diameter on the lattice: f = (2/3) E* d^(1/2) delta^(3/2) (equation 23). Exact for equal balls."""

    name = "ala"

    @property
    def _law(self) -> Law:
        return self.packing.law


@dataclass(frozen=True)
class AveragedForce(_ByLaw):
    """Balls that differ, held at the sites of the lattice: f is the mean over pairs (equation 25)."""

    name = "afa"

    @property
    def _law(self) -> Law:
        spread = self.packing.spread
        return AveragedLaw(self.packing.law.coefficient, self.packing.width, spread.shape) if spread else self.packing.law


@dataclass(frozen=True, init=False)
class EffectiveMedium(_ByLaw):
    """Balls that differ and displace their neighbours, in a lattice that is the average of all (equations 28-46).

    Valid from f* = 0.08 (Section IV), which states carry as ``valid``; solved from f* = 1e-6, to 1e-8 or better in force
    and stiffness from 1e-4 on. Each pair of listed diameters puts a kink into the law, which is resolved. Of some lists
    with kinds rarer than about 1 % the stiffness falls to zero at a higher f*, and the equation has no solution below.

    Parameters
    ----------
    packing : the balls.
    local_field : "computed"; or "paper" for the printed alpha and beta, which do not satisfy their own definition, and
        belong to the triangular lattice.

    Raises
    ------
    InputError : another word, or "paper" on another lattice.
    """

    name = "ema"
    options = {"local_field": ("computed", "paper")}
    source: str

    def __init__(self, packing: Packing, local_field: Literal["computed", "paper"] = "computed") -> None:
        if not isinstance(local_field, str) or local_field not in self.options["local_field"]:
            raise InputError(message(f"local_field is {brief(local_field)}", mend="Give 'computed' or 'paper'"))
        if local_field == "paper" and isinstance(packing, Packing) and packing.structure != TRIANGULAR:
            raise InputError(
                message(f"the paper has no local field of the {packing.structure.name} lattice", mend="Use 'computed'")
            )
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "source", local_field)
        self.__post_init__()

    def __repr__(self) -> str:
        return f"EffectiveMedium({self.packing!r}, local_field={self.source!r})"

    @cached_property
    def local_field(self) -> LocalField:
        """The local-field factor Xi, and alpha and beta, of the packing's lattice and Mindlin ratio."""
        eta = self.packing.mindlin_ratio
        return paper_local_field(eta) if self.source == "paper" else local_field(self.packing.structure, eta)

    @property
    def _law(self) -> Law:
        spread, law = self.packing.spread, self.packing.law
        return EffectiveLaw(law.coefficient, spread.width, spread.shape, self.local_field.xi) if spread else law


def untouched(overlap: ArrayLike, largest: float) -> InputError:
    """What to say of an overlap at which all balls are apart, the ``largest`` ones (m above the mean) too."""
    return InputError(
        message(
            f"overlap = {overlap!r}: no balls touch",
            f"The largest are {largest:g} m wider than the mean",
            f"Give an overlap above {-largest:g} m",
        )
    )


def compressive(name: str, values: ArrayLike) -> Array:
    """Loads as an array; :class:`InputError` if one is not a finite number above zero."""
    array = finite(name, values)
    if np.any(array < 0.0):
        raise InputError(
            message(f"{name} is {brief(values)}: tensile", "One-sided contacts carry no tension", "Give a load above zero")
        )
    if np.any(array == 0.0):
        raise InputError(
            message(f"{name} is zero", "Balls that only touch have no stiffness, and carry no sound", "Press them")
        )
    return array


def finite(name: str, values: ArrayLike) -> Array:
    array = real_array(name, values)
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(message(f"{name} is {brief(values)}", "Every load must be a finite number"))
    return array
