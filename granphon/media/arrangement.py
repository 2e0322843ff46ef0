"""Balls of several kinds and how they are arranged, as a scene says: an arrangement, the crystal
that it makes, and the medium of the crystal.

An arrangement stands where a scene, a sweep and their tasks have a packing, so that there is one
path for both. Unlike a crystal, an arrangement is plain data: balls can be changed, and the crystal
is then made anew.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from granphon.balls.ball import Ball, Wall
from granphon.balls.contact_laws import Hertz
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load, given_load
from granphon.balls.motions import Motions
from granphon.balls.on_site import (
    DISPLACEMENTS,
    ON_SITE,
    ROTATION,
    ROTATIONS,
    SPRING_PARAMETERS,
    change_springs,
    find_stiffness,
    find_unit,
    list_spring_parameters,
    name_springs,
    read_on_site,
)
from granphon.balls.packing import KIND_PARAMETERS, WALL_PARAMETERS, Packing, given_packing
from granphon.base.arrays import Array
from granphon.base.differences import Course
from granphon.base.errors import InputError, brief
from granphon.base.text import closest, counted, list_names, spell
from granphon.base.validation import require_instance
from granphon.media.cells import QUICK_BALLS, CrystalCell
from granphon.media.crystal import Crystal, CrystalState, find_mindlin_ratio
from granphon.media.crystal_courses import CrystalFollower
from granphon.media.medium import CRYSTAL, Change, Medium
from granphon.media.network_file import NetworkFiles
from granphon.media.state import NetworkState

#: options of an arrangement that a crystal has too
_OPTIONS = ("law", "friction", "motions", "torsion", "bending", "on_site")
#: relative difference of two masses or inertias that is put down to rounding
_MASS_ROUNDING = 1e-12


@dataclass(frozen=True)
class Arrangement:
    """Balls of several kinds and how they are arranged: the blocks ``balls`` and ``crystal`` of a
    scene.

    Attributes
    ----------
    kinds : the name of each kind, and its :class:`~granphon.Ball`.
    lattice : name of the lattice, or the :class:`~granphon.Lattice`; None where ``cell`` and
        ``sites`` are given.
    order : names of the kinds that follow each other on the sites of the lattice; empty for all
        kinds.
    cell, sites : vectors along which the crystal repeats, m; the place of each ball, m, with the
        name of its kind.
    repeat : numbers of cells of the supercell along each period.
    cut : axis, number of layers, and (lower, upper) edge of each cut of the supercell, in turn.
    replace : numbers of balls after the cuts, each with the name of the kind that replaces the
        ball.
    remove : numbers of balls that are taken out last.
    law : the contact law, or pairs of names of kinds, each with its law.
    friction, motions, torsion, bending : as for a :class:`~granphon.Crystal`; torsion and bending
        are pure numbers.
    on_site : springs to the ground of each ball: one stiffness of displacements, N/m, or names of
        motions, each with its stiffness; of a given crystal the stiffnesses of each ball; None
        without springs.
    seed : of the diameters of balls, if kinds have a spread: the supercell is then a sample,
        :meth:`Crystal.sample`.
    deviations : of the diameters of the balls of a given :meth:`Crystal.sample` from those of their
        kinds, m; empty of any other arrangement.
    given : the crystal itself, if it was not made of the other attributes.

    Two arrangements are equal if all attributes but ``given`` are.

    Raises
    ------
    InputError : ``kinds`` that are no pairs of a name and a ball, or with a name twice, a ``given``
        that is no crystal, and attributes that make no crystal. The other tuples are taken to have
        the entries that are written above.
    """

    kinds: tuple[tuple[str, Ball], ...]
    lattice: str | Lattice | None = None
    order: tuple[str, ...] = ()
    cell: tuple[tuple[float, ...], ...] = ()
    sites: tuple[tuple[tuple[float, ...], str], ...] = ()
    repeat: tuple[int, ...] = ()
    cut: tuple[tuple[Any, int, tuple[str | Wall, str | Wall]], ...] = ()
    replace: tuple[tuple[int, str], ...] = ()
    remove: tuple[int, ...] = ()
    law: Any = field(default_factory=Hertz)
    friction: bool = True
    motions: str | None = None
    torsion: float | str = 0.0
    bending: float = 0.0
    on_site: Any = None
    seed: int = 0
    deviations: tuple[float, ...] = field(default=(), repr=False)
    given: Crystal | None = field(default=None, repr=False, compare=False)

    #: name of the medium of such balls
    medium_name: ClassVar[str] = CRYSTAL
    #: whether the balls are those of a network in files, whose waves are its own
    is_network: ClassVar[bool] = False
    #: the distribution of diameters about that of their kind, and its width, m: none
    spread: ClassVar[None] = None
    width: ClassVar[float] = 0.0

    @classmethod
    def of(cls, crystal: Crystal) -> Arrangement:
        """Return the arrangement of a crystal that exists already, which it keeps as ``given``.

        The other attributes describe the crystal as it is: each ball with its position, and, of a
        sample, its deviation; each pair of faces as a cut of zero layers. A crystal cannot be made
        of them again: they serve for comparison and for tables.
        """
        kind_of_ball = np.array(crystal.names, object)[crystal.kind].tolist()
        positions = map(tuple, crystal.positions.tolist())
        options = {name: getattr(crystal, name) for name in _OPTIONS}
        if crystal.on_site is not None:  # tuples, as an arrangement can be hashed
            options["on_site"] = tuple(map(tuple, crystal.on_site.tolist()))
        deviations = () if crystal.deviations is None else tuple(crystal.deviations.tolist())
        # a ball has the name of its kind, and none of its own, as in an arrangement from a file
        balls = [replace(ball, name="") for ball in crystal.kinds]
        return cls(
            tuple(zip(crystal.names, balls, strict=True)),
            cell=tuple(map(tuple, crystal.cell.tolist())),
            sites=tuple(zip(positions, kind_of_ball, strict=True)),
            cut=tuple((face.axis, 0, (face.edges[0], face.edges[1])) for face in crystal.faces),
            **options,
            deviations=deviations,
            given=crystal,
        )

    def __post_init__(self) -> None:
        """Make the crystal, which raises the errors of attributes that make none."""
        self._require_kinds()
        if self.given is not None:
            require_instance("given", self.given, Crystal, "Give a granphon.Crystal")
        _ = self.crystal

    def _require_kinds(self) -> None:
        """Raise InputError unless :attr:`kinds` are pairs of a name, each another, and a ball."""
        kinds: Any = self.kinds  # the caller may have given anything
        if not (isinstance(kinds, tuple) and all(map(_is_kind, kinds))):
            mend = 'Give pairs of a name and a granphon.Ball, as (("A", ball),)'
            raise InputError(f"the kinds are {brief(kinds)}", mend=mend)
        if len(self._named_balls) < len(kinds):
            names = list_names([name for name, _ in kinds])
            raise InputError(f"the kinds are called {names}", mend="Give each another name")

    @property
    def repeats(self) -> bool:
        """Whether the crystal has a period."""
        return self.crystal.periods > 0

    def require_words(self) -> None:
        """Raise InputError if a scene file has no words for the crystal: if the crystal was given,
        and is a sample or a cut or has springs to the ground.
        """
        if self.given is None:
            return
        parts = {
            "a sample": (self.deviations, "the kinds with their spread, and a seed"),
            "a cut": (self.cut, "the whole crystal, and crystal.cut"),
            "springs of each ball to the ground": (self.on_site, "crystal.on_site"),
        }
        for words, (attribute, keys) in parts.items():
            if attribute:
                problem = f"a scene file has no words for {words} of a crystal that exists already"
                mend = f"Write {keys} in the file, or call granphon.sweep"
                raise InputError(problem, "It describes how a crystal is made", mend)

    @cached_property
    def crystal(self) -> Crystal:
        """The crystal: the one that was given, or the one that the other attributes make."""
        if self.given is not None:
            return self.given
        cell = self._make_cell()
        has_spread = any(ball.spread for ball in cell.kinds)
        if not has_spread:  # nothing is drawn: any supercell can be cut
            supercell = cell.repeat(self.repeat) if self.repeat else cell
            return self._cut(supercell)
        has_defects = bool(self.replace or self.remove)
        if self.cut or has_defects:
            raise InputError(
                "a crystal is cut or has defects, and a kind of its balls has a spread",
                "Layers would repeat one sample",
                "Leave one of them out, or use gp.Crystal",
            )
        return cell.sample(self.repeat or None, self.seed)

    def _cut(self, supercell: Crystal) -> Crystal:
        """Return the crystal that is cut from a ``supercell``, with its defects."""
        crystal = supercell
        for axis, layers, edges in self.cut:
            # Miller indices are a tuple here, so that an arrangement can be hashed
            axis_or_indices = list(axis) if isinstance(axis, tuple) else axis
            crystal = crystal.cut(axis_or_indices, layers, tuple(map(self._find_edge, edges)))
        for index, name in self.replace:
            crystal = crystal.replace(index, self._find_ball(name))
        if self.remove:
            crystal = crystal.remove(list(self.remove))
        return crystal

    def _find_edge(self, edge: str | Wall) -> str | Wall:
        """Return an ``edge`` of a cut as a crystal takes it: a wall whose material is the name of a
        kind gets the material of that kind, also where no ball of the crystal is of the kind.

        Raises InputError if there is no such kind.
        """
        if isinstance(edge, Wall) and isinstance(edge.material, str):
            return replace(edge, material=self._find_ball(edge.material).material)
        return edge

    def _make_cell(self) -> Crystal:
        """Return the crystal of one cell, without defects."""
        options = {name: getattr(self, name) for name in _OPTIONS}
        # a tuple of pairs stands for a mapping, as an arrangement can be hashed
        for name in ("law", "on_site"):
            value = options[name]
            options[name] = dict(value) if isinstance(value, tuple) else value
        if self.lattice is None:
            site_balls = [self._find_ball(name) for _, name in self.sites]
            positions = [list(position) for position, _ in self.sites]
            return Crystal(site_balls, self.cell, positions, name="crystal", **options)
        order = self.order or tuple(self._named_balls)
        balls = [self._find_ball(name) for name in order]
        return Crystal.on(self.lattice, balls, **options)

    def _find_ball(self, name: str) -> Ball:
        """Return the ball of the kind ``name``; InputError if there is no such kind."""
        balls = self._named_balls
        if name not in balls:
            guess = closest(name, balls)
            mend = f"Did you mean {guess}?" if guess else f"Give one of {', '.join(balls)}"
            raise InputError(f"there is no kind of ball {name!r}", mend=mend)
        return balls[name]

    @cached_property
    def _named_balls(self) -> dict[str, Ball]:
        """The ball of each kind, which has the name of the kind."""
        return {name: replace(ball, name=name) for name, ball in self.kinds}

    # -- attributes that a packing has too ---------------------------------------------------------

    @property
    def kind_names(self) -> tuple[str, ...]:
        """Names of the kinds that have balls in the crystal."""
        return self.crystal.names

    @property
    def is_held(self) -> bool:
        """Whether a floor, a wall, a clamp or springs to the ground hold balls."""
        return self.crystal.is_held

    @property
    def diameter(self) -> float:
        """Mean diameter, m."""
        return 2.0 * float(np.mean(self.crystal.radii))

    @cached_property
    def structure(self) -> Lattice:
        """The cell of the crystal, in units of the mean diameter, in the place of a lattice."""
        return CrystalCell.of(self.crystal, self.diameter)

    @property
    def ball_motions(self) -> Motions:
        """The motions that each ball has."""
        return self.crystal.ball_motions

    @property
    def mass(self) -> float:
        """Mean mass of a ball, kg."""
        return float(np.mean(self.crystal.masses))

    @property
    def mindlin_ratio(self) -> float | None:
        """Ratio of the shear to the normal stiffness, see :func:`find_mindlin_ratio`; None if
        contacts do not have one ratio in common.
        """
        return find_mindlin_ratio(self.crystal)

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return the rows of the table of the arrangement in a notebook: name, value and SI unit of
        each quantity.
        """
        crystal = self.crystal
        rows = list[tuple[str, Any, str]]()
        for name, ball in self.kinds:
            if name in crystal.names:
                rows += _describe_kind(name, ball)
        counts = np.bincount(crystal.kind, minlength=len(crystal.kinds)).tolist()
        counts_of_kinds = zip(counts, crystal.names, strict=True)
        balls = ", ".join(f"{count} {name}" for count, name in counts_of_kinds)
        law = "of each pair" if isinstance(self.law, tuple) else type(self.law).__name__
        rows.append(("crystal", crystal.name, ""))
        rows.append(("balls of the cell", balls, ""))
        rows.append(("contact law", law, ""))
        for _, layers, edges in self.cut:
            words = [edge if isinstance(edge, str) else edge.describe() for edge in edges]
            # how many layers a given crystal has is not known
            layers_in_words = "" if self.given else f"{counted(layers, 'layer')}, "
            rows.append(("cut", f"{layers_in_words}{' and '.join(words)}", ""))
        if self.torsion:
            rows.append(("torsion", self.torsion, "k d^2"))
        if self.bending:
            rows.append(("bending", self.bending, "k d^2"))
        if self.on_site is not None:
            rows += _describe_springs(self.on_site)
        rows.append(("friction", self.friction, ""))
        rows.append(("motions", crystal.ball_motions.name.replace("_", " "), ""))
        return rows

    @cached_property
    def _walls(self) -> dict[str, Wall]:
        """The walls at the faces, by name, with their materials."""
        edges = [edge for face in self.crystal.faces for edge in face.edges]
        return {edge.name: edge for edge in edges if isinstance(edge, Wall)}

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the parameters that a sweep may vary.

        Those of a kind of balls are such as "A.density", those of a wall such as
        "wall.young_modulus", and those of springs to the ground such as "on_site" and "on_site.x".
        A kind that has no balls in the crystal, and whose material a wall has, has the elastic
        constants alone.
        """
        kinds_without_balls = sorted(self._kinds_of_walls - {*self.kind_names})
        elastic_owners = (*kinds_without_balls, *self._walls)
        pairs = [
            *itertools.product(self.kind_names, KIND_PARAMETERS),
            *itertools.product(elastic_owners, WALL_PARAMETERS),
        ]
        names = [f"{owner}.{parameter}" for owner, parameter in pairs]
        return (*names, *list_spring_parameters(self.crystal.named_motions))

    def list_own_parameters(self, kinds_of_walls: Collection[str] = ()) -> tuple[str, ...]:
        """Return the names of parameters of which no two change the same number, also where balls
        may not have another diameter, as their places are given (:meth:`change`).

        A wall of the material of a kind changes with the kind, and is left out. A kind of ball has
        "mass" if its mass was given, and otherwise "density". ``kinds_of_walls`` are names of kinds
        whose materials further walls have, such as the wall of a half space.
        """
        names = list[str]()
        for kind in self.kind_names:
            ball = self._named_balls[kind]
            density_or_mass = "density" if _has_solid_mass(ball) else "mass"
            names += [f"{kind}.{name}" for name in (*WALL_PARAMETERS, density_or_mass, "diameter")]
        all_kinds_of_walls = {*self._kinds_of_walls, *kinds_of_walls}
        kinds_without_balls = sorted(all_kinds_of_walls - {*self.kind_names})
        names_of_other_walls = [
            at_face.name
            for edge, at_face in self._pair_edges()
            if isinstance(at_face, Wall)
            and not (isinstance(edge, Wall) and isinstance(edge.material, str))
        ]
        # one wall may be at several faces
        owners = (*kinds_without_balls, *dict.fromkeys(names_of_other_walls))
        names += [".".join(pair) for pair in itertools.product(owners, WALL_PARAMETERS)]
        return (*names, *self._list_own_springs())

    def _list_own_springs(self) -> list[str]:
        """Return the names of the parameters of springs to the ground: one for all displacements or
        rotations if all of these have one stiffness, and otherwise one for each motion.
        """
        names = list[str]()
        for group, motions in ((ON_SITE, DISPLACEMENTS), (f"{ON_SITE}.{ROTATION}", ROTATIONS)):
            if group not in self.parameters:
                continue
            has_one_stiffness = self.read(group) is not None
            if has_one_stiffness:
                names.append(group)
                continue
            of_motions = [f"{ON_SITE}.{name}" for name in motions]
            names += [name for name in of_motions if name in self.parameters]
        return names

    def read(self, name: str) -> Any:
        """Return the value, SI, of one of the :attr:`parameters`, or of an elastic constant of any
        kind; None for springs of several stiffnesses.

        Raises :class:`~granphon.base.errors.InputError` for a parameter that the crystal does not
        have.
        """
        self._require_parameter(name)
        if name in SPRING_PARAMETERS:
            return find_stiffness(self.crystal.on_site, name, self.crystal.named_motions)
        owner, _, parameter = name.rpartition(".")
        if owner in self._walls:
            return getattr(self._walls[owner].solid, parameter)
        ball = self._named_balls[owner]
        ball_or_material = ball if hasattr(ball, parameter) else ball.material
        return getattr(ball_or_material, parameter)

    def _require_parameter(self, name: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless ``name`` is one of the
        :attr:`parameters`, or that of an elastic constant of a kind without balls.
        """
        owner, _, parameter = name.rpartition(".")
        is_elastic = owner in self._named_balls and parameter in WALL_PARAMETERS
        if name not in self.parameters and not is_elastic:
            raise InputError(
                f"the crystal has no parameter {name!r}",
                f"It has {', '.join(self.parameters)}",
                "Use one of these",
            )

    @cached_property
    def _kinds_of_walls(self) -> set[str]:
        """Names of the kinds after whose materials walls at the faces are made."""
        edges = [edge for edge, _ in self._pair_edges() if isinstance(edge, Wall)]
        return {edge.material for edge in edges if isinstance(edge.material, str)}

    def _pair_edges(self) -> list[tuple[str | Wall, str | Wall]]:
        """Return each edge of each cut, with the edge at the face of the crystal that it has
        become: a wall there has a material and a name, which the edge of the cut may lack.
        """
        return [
            pair
            for (_, _, edges), face in zip(self.cut, self.crystal.faces, strict=True)
            for pair in zip(edges, face.edges, strict=True)
        ]

    def change(self, values: Mapping[str, Any]) -> Arrangement:
        """Return the arrangement with other ``values`` of :attr:`parameters`, in SI units:
        {"A.diameter": 8e-3}, m.

        A mass or a moment of inertia that was given stays if the material or the diameter changes.
        The diameter of a kind changes the distances of balls, so that balls must lie on a named
        lattice. A stiffness is that of the springs of all balls. Raises
        :class:`~granphon.base.errors.InputError` for a parameter that the crystal does not have,
        for a number that the parameter may not be, and for balls that make no crystal.
        """
        balls = dict(self.kinds)
        walls = dict[str, Wall]()
        springs = dict[str, float]()
        for name, value in values.items():
            self._require_parameter(name)
            owner, _, parameter = name.rpartition(".")  # "A.density", of a kind or a wall
            if name in SPRING_PARAMETERS:
                springs[name] = value
            elif owner in self._walls:
                wall = walls.get(owner, self._walls[owner])
                material = replace(wall.solid, **{parameter: value})
                walls[owner] = replace(wall, material=material)
            else:
                balls[owner] = _change_ball(balls[owner], parameter, value)
        if self.given is not None:
            return Arrangement.of(self._change_given(balls, walls, springs))
        changes: dict[str, Any] = {"kinds": tuple(balls.items())}
        if springs:
            changes["on_site"] = self._change_springs(springs)
        if walls:
            changes["cut"] = self._change_cuts(walls)
        return replace(self, **changes)

    def _change_given(
        self, balls: Mapping[str, Ball], walls: Mapping[str, Wall], springs: Mapping[str, float]
    ) -> Crystal:
        """Return the given crystal with other balls and walls, by their names, and with springs to
        the ground of other stiffnesses, by the names of their parameters, N/m or N m.
        """
        assert self.given is not None
        crystal = self.given.with_balls(balls).with_walls(walls)
        if not springs:
            return crystal
        n = crystal.n_balls
        on_site = change_springs(crystal.on_site, springs, crystal.named_motions, n)
        return crystal.with_springs(on_site)

    def _change_springs(self, changes: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
        """Return :attr:`on_site` with the ``changes``, stiffnesses by the names of parameters, N/m
        or N m: a pair of each motion and its stiffness, which holds for every ball.
        """
        motions = self.crystal.named_motions
        value = dict(self.on_site) if isinstance(self.on_site, tuple) else self.on_site
        (springs,) = change_springs(read_on_site(value, motions, 1), changes, motions, 1)
        return tuple(zip(name_springs(motions), springs.tolist(), strict=True))

    def _change_cuts(self, walls: Mapping[str, Wall]) -> tuple[Any, ...]:
        """Return :attr:`cut` with other ``walls``, by the names that the walls have at the faces of
        the crystal.
        """
        cuts = []
        for (axis, layers, edges), face in zip(self.cut, self.crystal.faces, strict=True):
            # the edge at the face of the crystal has a name, which the edge of the cut may lack
            changed_edges = [
                walls.get(at_face.name, edge) if isinstance(at_face, Wall) else edge
                for edge, at_face in zip(edges, face.edges, strict=True)
            ]
            cuts.append((axis, layers, tuple(changed_edges)))
        return tuple(cuts)


def _is_kind(entry: Any) -> bool:
    """Return whether an ``entry`` is a pair of the name of a kind and its ball."""
    is_pair = isinstance(entry, tuple) and len(entry) == 2
    return is_pair and isinstance(entry[0], str) and isinstance(entry[1], Ball)


def _describe_springs(on_site: Any) -> list[tuple[str, Any, str]]:
    """Return the rows of a table for springs to the ground: name, value and SI unit of each.

    ``on_site`` is that of :class:`Arrangement`: one stiffness, a tuple of pairs of a name and a
    stiffness, or a tuple of rows, the stiffnesses of each ball.
    """
    if not isinstance(on_site, tuple):
        return [("springs to the ground", on_site, "N/m")]
    has_names = isinstance(on_site[0][0], str)
    if not has_names:
        return [("springs to the ground", "of each ball", "")]
    return [
        (f"springs to the ground, {spell(name)}", stiffness, find_unit(name))
        for name, stiffness in on_site
    ]


def _describe_kind(name: str, ball: Ball) -> list[tuple[str, Any, str]]:
    """Return the rows of a table for the ball of the kind ``name`` and its material: name, value
    and SI unit of each constant.
    """
    rows: list[tuple[str, Any, str]] = [
        (f"diameter of {name}", ball.diameter, "m"),
        (f"mass of {name}", ball.mass, "kg"),
    ]
    if ball.spread is not None:
        rows.append((f"spread of {name}", ball.spread.kind, ""))
        rows.append((f"width of {name}", ball.spread.width, "m"))
    units = {"young_modulus": "Pa", "density": "kg/m^3", "yield_strength": "Pa"}
    for constant, value in vars(ball.material).items():
        if value is not None:
            rows.append((f"{spell(constant)} of {name}", value, units.get(constant, "")))
    return rows


def _has_solid_mass(ball: Ball) -> bool:
    """Return whether the mass of a ball is that of a solid ball; another mass was given."""
    solid_mass = ball.material.ball_mass(ball.diameter)
    return math.isclose(ball.mass, solid_mass, rel_tol=_MASS_ROUNDING)


def _change_ball(ball: Ball, parameter: str, value: Any) -> Ball:
    """Return the ball with another ``value``, SI, of a ``parameter`` of its own or of its material.

    If the mass or the moment of inertia is that of a solid ball, it is computed again; if not, it
    was given, and stays.
    """
    changes: dict[str, Any] = {}
    solid_inertia = 0.1 * ball.mass * ball.diameter**2  # (2/5) m R^2
    # None lets the new ball compute the number of a solid one
    if _has_solid_mass(ball):
        changes["mass"] = None
    if math.isclose(ball.inertia, solid_inertia, rel_tol=_MASS_ROUNDING):
        changes["inertia"] = None
    if parameter in ("diameter", "mass"):
        changes[parameter] = value
    else:
        changes["material"] = replace(ball.material, **{parameter: value})
    return replace(ball, **changes)


#: the balls that a scene, a sweep or a task is about
Balls = Packing | Arrangement | NetworkFiles


def find_kinds(balls: Balls) -> dict[str, Ball]:
    """Return the balls of an arrangement by the names of their kinds; empty for other balls, which
    have no kinds.
    """
    return dict(balls.kinds) if isinstance(balls, Arrangement) else {}


def given_balls(packing: Any) -> Packing | Arrangement:
    """Return ``packing``, the argument of a public call, as a packing or an arrangement; a crystal
    becomes its arrangement. Raises InputError for any other argument, also for a packing in files,
    which has one load and no parameters.
    """
    if isinstance(packing, Crystal):
        return Arrangement.of(packing)
    if isinstance(packing, NetworkFiles):
        fault = f"packing is that of the files {list_names([file.name for file in packing.files])}"
        mend = "Give a granphon.Packing or Crystal; a granphon.Scene takes files"
        raise InputError(fault, "These have one load, and no parameters to vary", mend)
    return packing if isinstance(packing, Arrangement) else given_packing(packing)


class LoadedCrystal(NetworkState):
    """The states of a crystal as scenes and sweeps take them: one number at each load for the many
    contacts.

    The numbers are means over the closed contacts, which have a normal stiffness, and zero where
    all are open; of a sample, over all contacts. Attributes have the shape of the load.

    Parameters
    ----------
    packing : the arrangement.
    source : the states of its crystal.
    """

    medium = CRYSTAL
    regime = None
    n_samples = 0
    finite_overlap = False
    chosen_automatically = False

    def __init__(self, packing: Arrangement, source: CrystalState) -> None:
        super().__init__(source, tuple(source.warnings))
        self.packing = packing
        self.finite_overlap = source.finite_overlap
        self.name = packing.structure.name

    def __getitem__(self, index: Any) -> LoadedCrystal:
        """Return the state at some of the loads, indexed like an array; the errors are those of
        :func:`~granphon.media.state.select_loads`.
        """
        return type(self)(self.packing, self.source[index])

    @property
    def mean_errors(self) -> dict[str, Any]:
        """Standard errors over samples, as of a :class:`ContactState`: none."""
        return {}

    @property
    def limits(self) -> Any:
        """The conditions that limit the state, see :attr:`CrystalState.limits`."""
        return self.source.limits

    @property
    def valid(self) -> Any:
        """Whether each state is within the range of its contact laws, see
        :attr:`CrystalState.valid`.
        """
        return self.source.valid

    def _average(self, quantity: Array) -> Any:
        """Return the mean over contacts of a ``quantity`` (..., n_c), with the shape (...) of the
        load.

        Open contacts do not count, and the mean is zero if all are open, as where springs to the
        ground alone hold the balls. Of a sample, whose contacts open one by one, all contacts
        count, as in :meth:`Crystal.at_force`.
        """
        is_counted = self.source.normal_stiffness > 0.0
        is_sample = bool(np.any(self.source.crystal.deviations))
        if is_sample:
            is_counted = np.ones_like(is_counted)
        counts = np.count_nonzero(is_counted, axis=-1)
        return (np.sum(quantity, axis=-1, where=is_counted) / np.maximum(counts, 1))[()]

    @property
    def force(self) -> Any:
        """Mean normal force, N."""
        return self._average(self.source.normal_force)

    @property
    def overlap(self) -> Any:
        """Mean overlap, m."""
        return self._average(self.source.overlap)

    @property
    def normal_stiffness(self) -> Any:
        """Mean normal stiffness, N/m."""
        return self._average(self.source.normal_stiffness)

    @property
    def shear_stiffness(self) -> Any:
        """Mean shear stiffness, N/m."""
        return self._average(self.source.shear_stiffness)

    @property
    def relative_overlap(self) -> Any:
        """Mean overlap over the mean diameter."""
        return self.overlap / self.packing.diameter

    @property
    def contact_fraction(self) -> Any:
        """Fraction of the contacts of the crystal that have a normal stiffness: those that are
        closed.
        """
        return np.mean(self.source.normal_stiffness > 0.0, axis=-1)[()]

    @property
    def pressure(self) -> Any:
        """Mean pressure, minus the trace of the stress over the number of periods: N, N/m or Pa.

        Raises :class:`~granphon.base.errors.InputError` for a crystal that was cut, as the stress
        of a strip or slab is that of the whole layer, and a column has none; and for a cluster
        without periods.
        """
        crystal = self.packing.crystal
        if not (crystal.periods or crystal.faces):
            raise InputError(
                "a cluster without periods has no stress", mend="Read the forces of its contacts"
            )
        if crystal.faces:
            raise InputError(
                "the stress of a strip, slab or column is no pressure",
                mend="Read the forces of its contacts",
            )
        trace = np.trace(self.source.stress, axis1=-2, axis2=-1)
        return (-trace / crystal.periods)[()]

    @property
    def exponent(self) -> Any:
        """The exponent of sound velocities, see :attr:`CrystalState.exponent`; None where
        velocities do not have one in common, or no contact is closed.
        """
        try:
            return self.source.exponent
        except InputError:
            return None

    @property
    def exponent_error(self) -> Any:
        """Standard error of the exponent: zero, as the exponent is exact; None where the exponent
        is None.
        """
        return None if self.exponent is None else np.zeros(self.shape)[()]


class CrystalMedium(Medium[Any]):
    """The medium of an :class:`Arrangement`, the ``packing``: each contact has its own law and
    force.
    """

    name = CRYSTAL
    words = "crystal"

    packing: Any

    def __init__(self, packing: Any) -> None:
        self.packing = packing

    @property
    def is_quick(self) -> bool:
        """Whether the states take little time: those of up to :data:`QUICK_BALLS` balls do."""
        return bool(self.packing.crystal.n_balls <= QUICK_BALLS)

    def require_sound(self, pushed: bool = False) -> None:
        """Raise nothing, ``pushed`` or not: which contacts carry load is found with the state."""

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> Any:
        """Return the state at a load, with the shape of the values of the load.

        Under a stress or a strain each value of the load is a size that multiplies the tensor of
        the load. Gravity is an acceleration along :attr:`Crystal.downward`: towards the face that
        is held, or down the last axis, towards no face, where springs to the ground alone hold the
        balls. A side force acts as the force of a contact that it makes in a hexagonal frame.
        ``finite_overlap`` and the errors are those of the methods ``at_...`` of
        :class:`~granphon.Crystal`.
        """
        crystal = self.packing.crystal
        load = given_load(load).applied
        sizes = load.array
        options: dict[str, Any] = {"finite_overlap": finite_overlap}
        if load.gravity:  # a gravity of zero needs no face that holds the balls
            options["gravity"] = load.gravity * crystal.downward
        if load.tensor is not None:
            # matrices (..., p, p): components (..., 1) of one period could pass for a matrix
            shear_factor = 0.5 if load.kind == "strain" else 1.0
            tensor = crystal._read_tensor(load.kind, load.tensor, shear_factor)
            sizes = np.asarray(sizes)[..., None, None] * tensor
        methods: dict[str, Callable[..., CrystalState]] = {
            "force": crystal.at_force,
            "overlap": crystal.at_overlap,
            "pressure": crystal.at_pressure,
            "stress": crystal.at_stress,
            "strain": crystal.at_strain,
        }
        find_state = methods[load.kind]
        return LoadedCrystal(self.packing, find_state(sizes, **options))

    def follow(
        self, load: Load, changes: Sequence[Change], finite_overlap: bool | None = None
    ) -> tuple[Any, list[Course[Any]]]:
        """Return the state at a single load, and its course with each of the ``changes``, found by
        the linear response of the balls at rest; see :meth:`Medium.follow`.
        """
        state = self.at(load, finite_overlap=finite_overlap)
        follower = CrystalFollower(state.source, load)

        def follow_change(change: Change) -> Course[Any]:
            """Return the course of the state with a ``change`` of the medium and the load."""

            def change_crystal(step: float) -> tuple[Crystal, Load]:
                """Return the crystal of the changed medium, and the changed load."""
                medium, changed_load = change(step)
                return medium.packing.crystal, changed_load

            course = follower.follow(change_crystal)

            def find_state(step: float) -> LoadedCrystal:
                """Return the state at a ``step`` with the means over its contacts."""
                medium, _ = change(step)
                return LoadedCrystal(medium.packing, course.at(step))

            return Course(find_state, course.step)

        return state, [follow_change(change) for change in changes]
