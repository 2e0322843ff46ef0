"""Balls of several kinds and how they are arranged, as a scene says it: the crystal that it makes,
and its medium.

An arrangement stands where a scene, a sweep and their tasks have a packing, so that there is one
path for both. Unlike a crystal it is plain data: balls can be changed, and the crystal is then made
anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.contact_laws import Hertz
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.motions import Motions
from granphon.balls.packing import KIND_PARAMETERS, Packing, given_packing
from granphon.base.errors import InputError
from granphon.base.text import closest, counted, spell
from granphon.media.crystal import Crystal, CrystalState
from granphon.media.medium import Medium
from granphon.media.state import NetworkState

#: what an arrangement takes as a crystal does
_OPTIONS = ("law", "friction", "motions", "torsion", "bending")
#: balls of a crystal up to which its states are found when a scene is only checked
_QUICK_BALLS = 500


@dataclass(frozen=True)
class CrystalCell(Lattice):
    """The cell of a crystal, in units of the mean diameter; ``sites`` are fractions, or distances
    across the periods.

    What repeats nowhere is put into a cell along x, beyond the reach of its neighbours.
    """

    #: length of the longest contact, in mean diameters
    reach: float = field(default=1.0, compare=False)
    #: number of axes along which a pressure acts: the periods, and those across which the crystal
    #: was cut
    pressed_axes: int = field(default=1, compare=False)

    def __post_init__(self) -> None:
        """Take the cell as it is: a crystal is checked when it is made."""

    @classmethod
    def of(cls, crystal: Crystal, diameter: float) -> CrystalCell:
        """Return the cell of a crystal, whose contacts are in m."""
        places = crystal.positions.copy()
        vectors = crystal.cell
        if not crystal.periods:
            vectors = np.eye(places.shape[1])[:1] * (
                float(np.ptp(places[:, 0])) + 4.0 * float(np.max(crystal.radii))
            )
        p = len(vectors)
        places[:, :p] = places[:, :p] @ np.linalg.inv(vectors[:, :p])
        places[:, p:] /= diameter
        reach = float(np.linalg.norm(crystal.contacts.vector, axis=1).max(initial=0.0)) / diameter
        rows, sites = (tuple(map(tuple, one.tolist())) for one in (vectors / diameter, places))
        cell = cls(crystal.name, rows, sites, reach, max(1, crystal.periods + len(crystal.faces)))
        cell.__dict__["contacts"] = crystal.contacts
        return cell


@dataclass(frozen=True)
class Arrangement:
    """Balls of several kinds and how they are arranged: the blocks ``balls`` and ``crystal`` of a
    scene.

    Attributes
    ----------
    kinds : the name of each kind, and its :class:`~granphon.Ball`.
    lattice : name of the lattice, or the :class:`~granphon.Lattice`; None where ``cell`` and
        ``sites`` are given.
    order : names of the kinds that follow each other on the sites of the lattice; empty for all of
        them.
    cell, sites : vectors along which the crystal repeats, m; the place of each ball, m, with the
        name of its kind.
    repeat : numbers of cells of the supercell along each period.
    cut : axis, number of layers, and (lower, upper) edge of each cut of that supercell, in turn.
    replace : numbers of balls of what was cut, each with the name of the kind that takes its place.
    remove : numbers of balls that are taken out then.
    law : the contact law, or pairs of names of kinds, each with its law.
    friction, motions, torsion, bending : as for a :class:`~granphon.Crystal`; torsion and bending
        are pure numbers.
    seed : of the diameters of balls, if kinds have a spread: the supercell is then a sample,
        :meth:`Crystal.sample`.
    given : the crystal itself, if it was not made of the others.

    Raises
    ------
    InputError : what makes no crystal.
    """

    kinds: tuple[tuple[str, Ball], ...]
    lattice: str | Lattice | None = None
    order: tuple[str, ...] = ()
    cell: tuple[tuple[float, ...], ...] = ()
    sites: tuple[tuple[tuple[float, ...], str], ...] = ()
    repeat: tuple[int, ...] = ()
    cut: tuple[tuple[Any, int, tuple[str, str]], ...] = ()
    replace: tuple[tuple[int, str], ...] = ()
    remove: tuple[int, ...] = ()
    law: Any = field(default_factory=Hertz)
    friction: bool = True
    motions: str | None = None
    torsion: float | str = 0.0
    bending: float = 0.0
    seed: int = 0
    given: Crystal | None = field(default=None, repr=False, compare=False)

    #: the distribution of diameters about that of their kind, and its width, m: none
    spread: ClassVar[None] = None
    width: ClassVar[float] = 0.0

    @classmethod
    def of(cls, crystal: Crystal) -> Arrangement:
        """Return the arrangement that is a crystal; its faces stand as cuts of no layers."""
        names = np.array(crystal.names, object)[crystal.kind].tolist()
        return cls(
            tuple(zip(crystal.names, crystal.kinds, strict=True)),
            cell=tuple(map(tuple, crystal.cell.tolist())),
            sites=tuple(zip(map(tuple, crystal.positions.tolist()), names, strict=True)),
            cut=tuple((face.axis, 0, (face.edges[0], face.edges[1])) for face in crystal.faces),
            **{name: getattr(crystal, name) for name in _OPTIONS},
            given=crystal,
        )

    def __post_init__(self) -> None:
        """Make the crystal, which raises errors of what makes none."""
        _ = self.crystal

    @property
    def repeats(self) -> bool:
        """Whether the crystal has a period."""
        return self.crystal.periods > 0

    @cached_property
    def crystal(self) -> Crystal:
        """The crystal."""
        if self.given is not None:
            return self.given
        balls = {name: replace(ball, name=name) for name, ball in self.kinds}
        options = {name: getattr(self, name) for name in _OPTIONS}
        options["law"] = dict(self.law) if isinstance(self.law, tuple) else self.law

        def find(name: str) -> Ball:
            if name not in balls:
                guess = closest(name, balls)
                what = f"there is no kind of ball {name!r}"
                raise InputError(
                    what,
                    mend=f"Did you mean {guess}?" if guess else f"Give one of {', '.join(balls)}",
                )
            return balls[name]

        if self.lattice is None:
            places = [list(place) for place, _ in self.sites]
            found = Crystal(
                [find(name) for _, name in self.sites], self.cell, places, name="crystal", **options
            )
        else:
            found = Crystal.on(
                self.lattice, [find(name) for name in self.order or tuple(balls)], **options
            )
        if any(ball.spread for ball in found.kinds):
            if self.cut or self.replace or self.remove:
                what = "a crystal is cut or has defects, and a kind of its balls has a spread"
                raise InputError(
                    what,
                    "Layers would repeat one sample",
                    "Leave one of them out, or use gp.Crystal",
                )
            return found.sample(self.repeat or None, self.seed)
        if self.repeat:
            found = found.repeat(self.repeat)
        for axis, layers, edges in self.cut:
            found = found.cut(list(axis) if isinstance(axis, tuple) else axis, layers, edges)
        for index, name in self.replace:
            found = found.replace(index, find(name))
        return found.remove(list(self.remove)) if self.remove else found

    # -- what a packing has too --------------------------------------------------------------------

    @property
    def kind_names(self) -> tuple[str, ...]:
        """Names of the kinds of which there are balls."""
        return self.crystal.names

    @property
    def is_held(self) -> bool:
        """Whether a floor or clamp holds balls."""
        return self.crystal.is_held

    @property
    def diameter(self) -> float:
        """Mean diameter, m."""
        return 2.0 * float(np.mean(self.crystal.radii))

    @cached_property
    def structure(self) -> Lattice:
        """The cell, in units of the mean diameter."""
        return CrystalCell.of(self.crystal, self.diameter)

    @property
    def ball_motions(self) -> Motions:
        """The motions of each ball."""
        return self.crystal.ball_motions

    @property
    def mass(self) -> float:
        """Mean mass of a ball, kg."""
        return float(np.mean(self.crystal.masses))

    @property
    def mindlin_ratio(self) -> float | None:
        """Ratio of the shear to the normal stiffness; None if contacts do not have it in common."""
        ratios = self.crystal.mindlin_ratios if self.friction else np.zeros(1)
        if np.any(ratios) and self.crystal._springs.know_radii:  # it depends on the load
            return None
        return float(ratios[0]) if np.ptp(ratios) <= 1e-12 else None

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of what describes it, as a notebook shows them."""
        crystal = self.crystal
        rows = list[tuple[str, Any, str]]()
        for name, ball in ((name, ball) for name, ball in self.kinds if name in crystal.names):
            own = ball.material
            unit = {"young_modulus": "Pa", "density": "kg/m^3", "yield_strength": "Pa"}
            told = {key: value for key, value in vars(own).items() if value is not None}
            rows += [
                (f"diameter of {name}", ball.diameter, "m"),
                (f"mass of {name}", ball.mass, "kg"),
            ]
            if (spread := ball.spread) is not None:
                rows += [
                    (f"spread of {name}", type(spread).__name__.lower(), ""),
                    (f"width of {name}", spread.width, "m"),
                ]
            rows += [
                (f"{spell(key)} of {name}", value, unit.get(key, "")) for key, value in told.items()
            ]
        counts = [np.count_nonzero(crystal.kind == number) for number in range(len(crystal.kinds))]
        balls = ", ".join(
            f"{count} {name}" for count, name in zip(counts, crystal.names, strict=True)
        )
        law = "of each pair" if isinstance(self.law, tuple) else type(self.law).__name__
        rows += [
            ("crystal", crystal.name, ""),
            ("balls of the cell", balls, ""),
            ("contact law", law, ""),
        ]
        rows += [
            ("cut", f"{counted(layers, 'layer')}, {' and '.join(edges)}", "")
            for _, layers, edges in self.cut
        ]
        rows += [
            (name, getattr(self, name), "k d^2")
            for name in ("torsion", "bending")
            if getattr(self, name)
        ]
        return [
            *rows,
            ("friction", self.friction, ""),
            ("motions", crystal.ball_motions.name.replace("_", " "), ""),
        ]

    def change(self, values: Mapping[str, Any]) -> Arrangement:
        """Return the arrangement with other ``values`` of parameters of kinds, in SI units:
        {"A.diameter": 8e-3}, m.

        A mass that was given stays if the material or the diameter changes. The diameter of a kind
        changes the distances of balls, so that they must lie on a lattice.
        """
        balls = dict(self.kinds)
        for name, value in values.items():
            kind, _, own = name.rpartition(".")
            if kind not in self.kind_names or own not in KIND_PARAMETERS:
                allowed = ", ".join(
                    f"{one}.{parameter}" for one in self.kind_names for parameter in KIND_PARAMETERS
                )
                raise InputError(
                    f"the crystal has no parameter {name!r}",
                    f"It has {allowed}",
                    "Use one of these",
                )
            ball = balls[kind]
            solid = math.isclose(ball.mass, ball.material.ball_mass(ball.diameter), rel_tol=1e-12)
            inner = math.isclose(ball.inertia, 0.1 * ball.mass * ball.diameter**2, rel_tol=1e-12)
            anew: dict[str, Any] = ({"mass": None} if solid else {}) | (
                {"inertia": None} if inner else {}
            )
            of_ball = own in ("diameter", "mass")
            anew |= (
                {own: value} if of_ball else {"material": replace(ball.material, **{own: value})}
            )
            balls[kind] = replace(ball, **anew)
        given = None if self.given is None else self.given.with_balls(balls)
        return replace(self, kinds=tuple(balls.items()), given=given)


#: what a scene, a sweep or a task is about
Balls = Packing | Arrangement


def given_balls(packing: Any) -> Balls:
    """Return ``packing``, the argument of a public call: a packing, or an arrangement, also of a
    crystal.
    """
    if isinstance(packing, Crystal):
        return Arrangement.of(packing)
    return packing if isinstance(packing, Arrangement) else given_packing(packing)


def _mean_of(name: str, what: str) -> property:
    """Return the property that is the mean of a field of the crystal's state over its contacts."""

    def find(state: LoadedCrystal) -> Any:
        # of a sample, whose contacts open one by one, all contacts count, as in Crystal.at_force
        live = (state.source.normal_stiffness > 0.0) | bool(np.any(state.source.crystal.deviations))
        return np.mean(getattr(state.source, name), axis=-1, where=live)[()]

    return property(find, doc=what)


class LoadedCrystal(NetworkState):
    """States of a crystal as sweeps and scenes have them: with means over the contacts that carry
    load, of a sample all.
    """

    medium = "crystal"
    regime = None
    n_samples = 0
    finite_overlap = False
    chosen_automatically = False
    mean_errors = dict[str, Any]()

    def __init__(self, packing: Arrangement, source: CrystalState) -> None:
        super().__init__(source, tuple(source.warnings))
        self.packing = packing
        self.finite_overlap = source.finite_overlap
        self.name = packing.structure.name

    def __getitem__(self, index: Any) -> LoadedCrystal:
        """Select some of the loads, by an index as for arrays."""
        return type(self)(self.packing, self.source[index])

    @property
    def limits(self) -> Any:
        """What limits the state, see :attr:`CrystalState.limits`."""
        return self.source.limits

    @property
    def valid(self) -> Any:
        """Whether each state is within the range of its contact laws."""
        return self.source.valid

    force = _mean_of("normal_force", "Mean normal force, N.")
    overlap = _mean_of("overlap", "Mean overlap, m.")
    normal_stiffness = _mean_of("normal_stiffness", "Mean normal stiffness, N/m.")
    shear_stiffness = _mean_of("shear_stiffness", "Mean shear stiffness, N/m.")

    @property
    def relative_overlap(self) -> Any:
        """Mean overlap over the mean diameter."""
        return self.overlap / self.packing.diameter

    @property
    def contact_fraction(self) -> Any:
        """Fraction of the contacts of the crystal that carry load."""
        return np.mean(self.source.normal_stiffness > 0.0, axis=-1)[()]

    @property
    def pressure(self) -> Any:
        """Mean pressure, minus the trace of the stress over the periods: N, N/m or Pa.

        Raises :class:`~granphon.base.errors.InputError` for what was cut, whose stress is that of
        the whole layer.
        """
        p = self.packing.structure.periods
        if self.packing.structure.pressed_axes > p:
            raise InputError(
                "a strip or slab has no stress in Pa", mend="Read the forces of its contacts"
            )
        return (-np.trace(self.source.stress, axis1=-2, axis2=-1) / p)[()]

    @property
    def exponent(self) -> Any:
        """The exponent of sound velocities, see :attr:`CrystalState.exponent`; None where there is
        none in common.
        """
        try:
            return self.source.exponent
        except InputError:
            return None

    @property
    def exponent_error(self) -> Any:
        """Its standard error: zero, as nothing is sampled."""
        return None if self.exponent is None else np.zeros(self.shape)[()]


class CrystalMedium(Medium[Any]):
    """Balls of several kinds, each contact with its own law and force: what an :class:`Arrangement`
    makes.
    """

    name = "crystal"
    words = "crystal"

    packing: Any

    def __init__(self, packing: Any) -> None:
        self.packing = packing

    @property
    def is_quick(self) -> bool:
        """Whether its states take less than 0.1 s."""
        return bool(self.packing.crystal.n_balls <= _QUICK_BALLS)

    def require_sound(self, pushed: bool = False) -> None:
        """Raise nothing: which contacts carry is found with the state."""

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> Any:
        """Return the state at a load, with the shape of the values of the load."""
        crystal = self.packing.crystal
        values = load.array
        options: dict[str, Any] = {"finite_overlap": finite_overlap}
        if load.gravity is not None:
            options["gravity"] = load.gravity * crystal.downward
        if load.tensor is not None:
            values = np.asarray(values)[..., None] * np.array(load.tensor)
        return LoadedCrystal(self.packing, getattr(crystal, f"at_{load.kind}")(values, **options))
