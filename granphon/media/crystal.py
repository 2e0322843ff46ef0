"""Crystals: balls of several kinds on any sites, and their contacts under any load.

A crystal is data: kinds of balls, a cell, positions at which neighbours touch, the law of each
contact, and how the edges are held. The methods ``at_...`` of a crystal find the state at rest
(:mod:`granphon.statics.find_rest`). Velocities, bands and waves are found from the network of
contacts of that state.

Where a crystal has been cut, the periods that remain lie along x, or in the xy plane, and the
layers follow each other along the next axis: y in a plane, z in space, x of a chain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.ball import (
    BALL_LIMITS,
    RIGID_PLANE,
    Ball,
    Body,
    ContactConstants,
    Wall,
    find_material,
    find_wall,
    name_walls,
    replace_walls,
)
from granphon.balls.contact_laws import (
    PairLaw,
    check_law,
    law_of_pair,
    read_laws,
)
from granphon.balls.contact_model import LAW_KINDS, ContactModel, GivenLaw
from granphon.balls.diameters import subtract_mean
from granphon.balls.hertz import NO_STIFFNESS, NO_TENSION, HertzLaw
from granphon.balls.lattices import LATTICES, Lattice, find_structure
from granphon.balls.layers import EDGES, Layers, find_faces, read_edges
from granphon.balls.motions import Motions, find_motions, select_motions
from granphon.balls.neighbours import (
    TOUCH,
    ContactTable,
    find_contacts,
    repeat_contacts,
    require_joined,
)
from granphon.balls.on_site import SpringLaw, read_on_site, turn_on_site
from granphon.balls.packing import read_rolling, require_shallow
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    choice,
    finite_array,
    index_array,
    label,
    lengths,
    require,
    truth,
    whole_number,
)
from granphon.contacts.assembly import Assembly
from granphon.contacts.grid import Grid
from granphon.contacts.laws import ContactLaws
from granphon.dynamics.elasticity import voigt_pairs
from granphon.media.crystal_sites import (
    find_dimension,
    find_kinds,
    list_balls,
    name_kinds,
    read_diameters,
    read_sites,
    require_cell,
    require_large_enough,
    require_symbols,
    scale_until_touch,
)
from granphon.media.limits import Check, check_limit
from granphon.media.mean_force import (
    MOST_MEANS,
    MeanContacts,
    MeanGoal,
    PressureSearch,
)
from granphon.media.sample_on_grid import SampleOnGrid
from granphon.media.state import read_finite_overlap, select_loads
from granphon.networks.network import ContactNetwork
from granphon.statics.configuration import BOUNDARIES, AppliedLoad, Boundary, Geometry
from granphon.statics.find_rest import find_rest
from granphon.statics.rest import Rest

#: most cells of a supercell along a period, and most layers of a cut
_MOST_CELLS = 1_000_000
#: most balls of a crystal, whose contacts are held in memory, about 1 kB a ball
_MOST_BALLS = 10_000_000
#: length of a spring to the ground, m: next to nothing, but with digits of its direction
_SPRING_LENGTH = 1e-60
#: memory of a ball, or of a contact, while a crystal is made and checked, bytes
_BALL_BYTES = 550.0
#: the arrays of a state, in the order of its fields
_PER_LOAD = (
    "normal_force",
    "overlap",
    "normal_stiffness",
    "normal",
    "displacements",
    "stress",
    "strain",
    "ways",
)
#: units of a pressure, by the number of axes along which it acts
_PRESSURE_UNITS = ("N", "N", "N/m", "Pa")
#: relative size of a component of a tensor or of gravity that is put down to rounding
_ROUNDING = 1e-12
#: difference of the exponents of contacts that is put down to rounding
_EXPONENT_ROUNDING = 1e-9
#: step of the overlap by which a shear stiffness is differentiated, over the length on which the
#: normal force and its stiffness change: an exponent is found to 1e-9
_SLOPE_STEP = 1e-4
#: difference of the exponents of the shear and the normal stiffness of a contact up to which they
#: count as one: to six digits the exponent of every velocity is then the same
_MOST_EXPONENT_DIFFERENCE = 1e-6
#: difference of the ratios of shear to normal stiffness of contacts that is put down to rounding
_RATIO_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Faces:
    """The two faces of a cut, across ``axis`` of the crystal, lower and upper.

    ``edges`` say how each face is held: "free", "clamped", "floor" or a wall with its material and
    name. ``balls`` are the numbers of the balls that each face touches, or of the layer that each
    face holds; ``thickness`` is the thickness of all layers together, m.
    """

    axis: int
    thickness: float
    edges: tuple[str | Wall, str | Wall] = field(metadata={"kind": (str | Wall, str | Wall)})
    balls: tuple[Index, Index] = field(metadata={"kind": (np.dtype(np.intp), np.dtype(np.intp))})

    def __post_init__(self) -> None:
        """Keep the numbers of balls as read-only arrays."""
        lower, upper = self.balls
        object.__setattr__(self, "balls", (read_only(lower), read_only(upper)))

    @property
    def is_pressed(self) -> bool:
        """Whether a load moves the upper face against the lower: neither face is free."""
        return "free" not in self.edges


class Side(NamedTuple):
    """One face of a cut across the ``axis``.

    ``sign`` is -1 of the lower face and 1 of the upper face, ``edge`` says how the face is held,
    and ``balls`` are the numbers of its balls. ``wall`` is the number of the wall that a load
    moves; -1 of a face that no load moves.
    """

    axis: int
    sign: float
    edge: str | Wall
    balls: Index
    wall: int

    @property
    def body(self) -> Body | None:
        """The flat body that the balls touch; None of a face without one."""
        return find_wall(self.edge)

    @property
    def strength(self) -> float:
        """The yield strength of the wall, Pa; infinite where it is not known, or there is no wall
        of a material.
        """
        strength = self.edge.solid.yield_strength if isinstance(self.edge, Wall) else None
        return math.inf if strength is None else strength


class _Bodies(NamedTuple):
    """What moves in the statics: balls, and walls on faces.

    Attributes
    ----------
    ball_number : (n,) the number of each ball among those that move by themselves; -1 of a ball of
        a clamped layer.
    walls : the faces of each cut whose upper face a load moves, as a wall.
    wall_of_ball : (n,) the number of the moving wall that carries each ball; -1 of a ball that none
        carries.
    """

    ball_number: Index
    walls: list[Faces]
    wall_of_ball: Index

    @property
    def n_balls(self) -> int:
        """Number of balls that move by themselves."""
        return int(np.count_nonzero(self.ball_number >= 0))

    @property
    def held_body(self) -> int:
        """The number, behind those of the balls and walls, of the body that stands for all that is
        held.
        """
        return self.n_balls + len(self.walls)

    @property
    def body_of_ball(self) -> Index:
        """(n,) the number of the body with which each ball moves: the balls that move by themselves
        come first, then the walls that move, and then one body for all that is held.
        """
        wall_or_held = np.where(
            self.wall_of_ball >= 0, self.n_balls + self.wall_of_ball, self.held_body
        )
        return np.where(self.ball_number >= 0, self.ball_number, wall_or_held)


class _Rows(NamedTuple):
    """Some of the m contacts of the statics.

    ``i`` and ``j`` (m,) are the bodies, numbered as :attr:`_Bodies.body_of_ball`. ``vector`` (m, d)
    leads from the centre of i at touch, m: to the centre of j, to the plane of a floor or wall, or
    along a spring to the ground. ``offset`` (m,) is the overlap there, m.
    """

    i: Index
    j: Index
    vector: Array
    offset: Array


@result_class
class Crystal(Result):
    """Balls of several kinds on the sites of a cell, which touch their neighbours.

    Parameters
    ----------
    balls : a :class:`~granphon.Ball` for each site.
    cell : (p, d) vectors as rows along which the crystal repeats, m; p <= d <= 3. One lies along x,
        two lie in the xy plane. An empty list for a cluster without periods.
    positions : (n, d) centres, m.
    law : the law of the normal force of all contacts, such as :class:`~granphon.Hertz` (the
        default), or a mapping from pairs of names of kinds to laws, {("A", "B"): law}; a registered
        law by its name. A floor is the kind "floor". An object of your own with the methods of
        :class:`~granphon.balls.contact_laws.PairLaw` serves for all pairs; its force is compared
        with its derivatives once. A law whose force is zero at overlaps below 0 only pushes. A law
        that pulls at overlaps below 0 is a bond, which never opens; or it adheres down to its
        ``least_overlap``, below which the force is zero.
    friction : whether contacts resist shear, with the stiffness of Mindlin for contacts that do not
        slip: kappa = 8 G* a, where the contact radius a of any law follows from its stiffness k = 2
        E* a.
    motions : the motions of each ball, as for :class:`~granphon.Packing`.
    torsion, bending : the stiffness of a contact against twist and rolling, over k times the square
        of the distance of its two centres; or torsion="mindlin", which is (16/3) a^3 over the sum
        of 1/G of both balls.
    on_site : springs to the ground, which pull balls back to where they touch without load, as
        magnets, grooves or a soft foundation do: a stiffness of all displacements, N/m; or a
        mapping {"x": ..., "rotation": ...} of displacements "x", "y", "z", N/m, and of all
        rotations "rotation", or one, "rotation_z", N m; or a list with one of these for each ball;
        or an array (n, motions). As an attribute it is this array, or None. A spring moves along
        with the strain of the cell. Springs of a clamped layer do nothing.
    name : what messages call the crystal.

    Attributes
    ----------
    kinds, names : the ball of each kind, and the name of each kind: A, B, C, ... if its ball has no
        name.
    kind : (n,) the number of the kind of each ball.
    deviations : (n,) diameters of the balls of a :meth:`sample`, minus the diameters of their
        kinds, m; None if the balls were not drawn.
    contacts : the :class:`~granphon.balls.neighbours.ContactTable`, in m.
    faces : the two faces of each cut, in the order of the cuts; empty of a crystal that was not
        cut.

    Raises
    ------
    InputError : arrays whose shapes do not fit, numbers that are not finite, an entry that is no
        ball, two kinds of one name, a kind called "floor"; a cell that does not lie along the first
        axes, or has no room for a ball; balls that overlap, that miss each other by less than a
        thousandth, or that touch nothing; contacts that do not join all balls; an unknown law, one
        that lacks a pair or a method, or that is not the derivative of its energy; motions, torsion
        and bending that :class:`~granphon.Packing` refuses; a spring of a motion that balls do not
        have, or with a stiffness below zero or not finite; a ``friction`` that is neither true nor
        false, and a ``name`` that is no text, empty, or has letters that cannot be seen.
    """

    _schema: ClassVar[int] = 2

    kinds: tuple[Ball, ...] = held((Ball, ...))
    names: tuple[str, ...] = held((str, ...))
    kind: Index = held(int, "n")
    cell: Array = held(float, "p d", within="finite")
    positions: Array = held(float, "n d", within="finite")
    contacts: ContactTable = held(ContactTable)
    law: GivenLaw = held(LAW_KINDS)
    friction: bool = held(bool)
    motions: str | None = held(str, "?")
    torsion: float | str = held(float | str)
    bending: float = held(float)
    name: str = held(str)
    faces: tuple[Faces, ...] = held((Faces, ...))
    deviations: Array | None = held(float, "n?", within="finite")
    on_site: Array | None = held(float, "n m?", within="zero or above")

    def __init__(
        self,
        balls: Sequence[Ball],
        cell: ArrayLike,
        positions: ArrayLike,
        *,
        law: Any = None,
        friction: bool = True,
        motions: str | None = None,
        torsion: float | str = 0.0,
        bending: float = 0.0,
        on_site: Any = None,
        name: str = "of these balls",
    ) -> None:
        require("name", label, name)
        centres, vectors = read_sites(positions, cell)
        n, d = centres.shape
        site_balls = list_balls(balls)
        if len(site_balls) != n:
            n_balls = len(site_balls)
            problem = f"there are {counted(n_balls, 'ball')} and {counted(n, 'position')}"
            raise InputError(problem, mend="Give one ball for each site")
        kinds, kind = find_kinds(site_balls)
        radii = np.array([ball.radius for ball in kinds])[kind]
        require_cell(vectors, float(np.mean(radii)), name)
        if len(vectors) == 0 and n == 1:
            raise InputError("a single ball without a period touches nothing", mend="Give a cell")
        contacts = find_contacts(vectors, centres, name, radii)
        read_torsion, read_bending = read_rolling(
            f"the crystal {name!r}", d, motions, torsion, bending
        )
        self._set(
            kinds=kinds,
            names=name_kinds(kinds),
            kind=kind,
            cell=vectors,
            positions=centres,
            contacts=contacts,
            law=read_laws(law),
            friction=require("friction", truth, friction),
            motions=motions,
            torsion=read_torsion,
            bending=read_bending,
            name=name,
            faces=(),
            deviations=None,
            on_site=read_on_site(on_site, find_motions(d, motions), n),
        )
        self._require_laws()

    def _set(self, **attributes: Any) -> None:
        """Set the attributes by their names, and make arrays read-only."""
        for name, value in attributes.items():
            frozen = read_only(value) if isinstance(value, np.ndarray) else value
            object.__setattr__(self, name, frozen)

    def _require_laws(self) -> None:
        """Find the law of each pair of kinds that touch, so that a missing or wrong law is an error
        at once.

        Raises :class:`~granphon.base.errors.InputError` if a pair lacks a law, or if
        :func:`~granphon.balls.contact_laws.check_law` refuses the law.
        """
        _ = self._laws

    @classmethod
    def _of_fields(cls, *values: Any) -> Self:
        """Make a crystal of the values of its fields, in the order of the class, unchecked."""
        crystal = object.__new__(cls)
        names = [field.name for field in fields(cls)]
        crystal._set(**dict(zip(names, values, strict=True)))
        return crystal

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for fields that the base class refuses,
        for motions, torsion, bending and laws that the constructor refuses, and for the faults of
        :meth:`_list_missing` and :meth:`_list_faults`.
        """
        super()._check()
        read_rolling(
            f"the crystal {self.name!r}", self.dimension, self.motions, self.torsion, self.bending
        )
        # the second list reads the kinds, balls and axes that the first one finds to be there
        for list_faults in (self._list_missing, self._list_faults):
            for fault, is_found in list_faults():
                if is_found:
                    problem = f"{fault} in the data of the crystal {self.name!r}"
                    raise InputError(problem, mend="Make the crystal again")
        self._require_laws()

    def _list_missing(self) -> list[tuple[str, bool]]:
        """Return in words each kind of thing that the data of a crystal may name and not have, and
        whether they do so.
        """
        table = self.contacts
        ends = np.concatenate([table.i, table.j, *(side.balls for side in self._sides)])
        has_kinds = bool(np.all(np.isin(self.kind, range(len(self.kinds)))))
        has_ends = bool(np.all(np.isin(ends, range(self.n_balls))))
        # the layers of a cut follow each other along an axis that is no period
        has_axes = all(self.periods <= face.axis < self.dimension for face in self.faces)
        return [
            ("a ball has no kind", not has_kinds),
            ("there are not as many names as kinds", len(self.names) != len(self.kinds)),
            ("a contact or a face names a ball that is not there", not has_ends),
            ("a cut is across an axis that is not there", not has_axes),
        ]

    def _list_faults(self) -> list[tuple[str, bool]]:
        """Return each fault that the data of a crystal may have in words, and whether they have it;
        all that the data name must be there, see :meth:`_list_missing`.
        """
        table = self.contacts
        radii = self._mean_radii
        separations = self.positions[table.j] + table.shift @ self.cell - self.positions[table.i]
        along_normal = table.normal * np.linalg.norm(separations, axis=1)[:, None]
        tolerance = TOUCH * float(np.mean(radii))

        def differ(numbers: Array, expected: Array) -> bool:
            """Return whether some of the numbers, m, are not the expected ones, to a millionth of
            the mean radius.
            """
            return not np.all(np.abs(numbers - expected) <= tolerance)

        has_wrong_arm = differ(table.arm_i, radii[table.i]) or differ(table.arm_j, radii[table.j])
        has_thickness = all(
            face.thickness > 0.0 and np.isfinite(face.thickness) for face in self.faces
        )
        has_edges = all(
            isinstance(edge, Wall) or edge in EDGES for face in self.faces for edge in face.edges
        )
        n_motions = self.named_motions.count
        has_springs = self.on_site is None or self.on_site.shape[1] == n_motions
        return [
            ("a contact does not lead from ball to ball", differ(table.vector, separations)),
            ("a normal is not along its contact", differ(along_normal, separations)),
            ("an arm is not the radius of its ball", has_wrong_arm),
            ("a cut has no thickness", not has_thickness),
            ("a face is held as no face is", not has_edges),
            ("springs to the ground are not those of the motions", not has_springs),
            ("a ball has no diameter", bool(np.any(self.radii <= 0.0))),
        ]

    def _derive(self, **changes: Any) -> Self:
        """Return the crystal with ``changes``: other values of some attributes, by name. Raises
        :class:`~granphon.base.errors.InputError` for kinds of which the law lacks a pair.
        """
        attributes = {field.name: getattr(self, field.name) for field in fields(self)}
        attributes |= changes
        crystal = self._of_fields(*attributes.values())
        crystal._require_laws()
        return crystal

    def _take(
        self, origin: Index, contacts: ContactTable, positions: Array, **changes: Any
    ) -> Self:
        """Return a crystal of the balls with the numbers ``origin`` (m,), which keep their kinds
        and their faces, at other ``positions`` (m, d), m, with ``contacts`` among these balls and
        ``changes`` of other attributes.
        """
        kind = self.kind[origin]
        # the kinds that remain, in the order in which their balls come, and their new numbers
        _, first_balls = np.unique(kind, return_index=True)
        used_kinds = kind[np.sort(first_balls)]
        new_number = np.full(len(self.kinds), -1, np.intp)
        new_number[used_kinds] = np.arange(len(used_kinds))
        faces = []
        for face in self.faces:
            lower, upper = face.balls
            new_lower = np.flatnonzero(np.isin(origin, lower))
            new_upper = np.flatnonzero(np.isin(origin, upper))
            faces.append(replace(face, balls=(new_lower, new_upper)))
        return self._derive(
            kinds=tuple(self.kinds[number] for number in used_kinds),
            names=tuple(self.names[number] for number in used_kinds),
            kind=new_number[kind],
            positions=positions,
            contacts=contacts,
            deviations=None if self.deviations is None else self.deviations[origin],
            on_site=None if self.on_site is None else self.on_site[origin],
            faces=tuple(faces),
            **changes,
        )

    # -- other ways to make a crystal --------------------------------------------------------------

    @classmethod
    def on(cls, lattice: str | Lattice, balls: Sequence[Ball], **options: Any) -> Self:
        """Make a crystal on a lattice: kinds of balls follow each other on its sites, and
        neighbours touch.

        Parameters
        ----------
        lattice : the name of a lattice of :class:`~granphon.Packing`, "NaCl", "CsCl" or
            "zincblende", or a :class:`~granphon.Lattice`. A chain takes any number of kinds, and
            has as many balls in its cell; elsewhere the number of sites in the cell must be a
            multiple of the number of kinds.
        balls : a ball of each kind.
        options : options of the class: law, friction, motions, torsion, bending, on_site, name.

        The cell is scaled until neighbours touch. Raises :class:`~granphon.base.errors.InputError`
        for an unknown lattice, for a number of kinds that does not go on its sites, for radii with
        which neighbours cannot all touch, or the larger balls touch each other first, and for
        arguments that the class refuses.
        """
        kinds = list_balls(balls)
        find_kinds(kinds)  # raises for an entry that is no ball
        structure = find_structure(lattice)
        if structure == LATTICES["chain"]:
            radii = np.array([ball.radius for ball in kinds])
            # each ball touches the next, and the last touches the first of the next cell
            next_centres = np.cumsum(radii + np.roll(radii, -1))
            positions = np.append(0.0, next_centres[:-1])[:, None]
            period = float(next_centres[-1])
            options = {"name": "chain"} | options
            return cls(kinds, [[period]], positions, **options)
        n = structure.n_balls
        if len(kinds) > n or n % len(kinds):
            raise InputError(
                f"{counted(len(kinds), 'kind')} of balls do not go on the {counted(n, 'site')} in"
                f" a cell of {structure.name}",
                "Kinds follow each other on the sites of one cell",
                "Give a lattice that has a multiple, such as NaCl or CsCl for two kinds, or a"
                " cell and places",
            )
        site_balls = [kinds[site % len(kinds)] for site in range(n)]
        scale = scale_until_touch(structure, site_balls)
        cell = scale * structure.vectors
        if len(kinds) == n == 2:
            require_large_enough(structure, cell, kinds)
        options = {"name": structure.name} | options
        return cls(site_balls, cell, scale * structure.positions, **options)

    @classmethod
    def from_atoms(cls, atoms: Any, balls: Mapping[str, Ball], **options: Any) -> Self:
        """Make a crystal from ``atoms``, an ``ase.Atoms`` with lengths in m, with one of ``balls``
        for each chemical symbol.

        ``options`` are those of the class. The crystal repeats along the vectors of the cell that
        are periodic. Where all balls have the same z and none of the periods leaves the plane, the
        crystal is plane; on a line it is a chain. Kinds are called by their symbols.

        Raises :class:`~granphon.base.errors.InputError` for an argument that is no ``ase.Atoms``,
        or has no atoms, for a symbol without a ball, and for arguments that the class refuses.
        """
        attributes = ("positions", "cell", "pbc", "get_chemical_symbols")
        if not all(hasattr(atoms, name) for name in attributes):
            problem = f"{brief(atoms)} are not Atoms"
            raise InputError(problem, mend="Give ase.Atoms, with lengths in m")
        symbols = atoms.get_chemical_symbols()
        require_symbols(symbols, balls)
        find_kinds([balls[symbol] for symbol in symbols])  # raises for an entry that is no ball
        ball_of_symbol = {
            symbol: replace(balls[symbol], name=symbol) for symbol in sorted(set(symbols))
        }
        positions = np.array(atoms.positions, float)
        is_periodic = np.array(atoms.pbc, bool)
        cell = np.array(atoms.cell, float)[is_periodic]
        tolerance = TOUCH * float(np.mean([ball.radius for ball in ball_of_symbol.values()]))
        d = find_dimension(positions, cell, tolerance)
        options = {"name": "of these atoms"} | options
        site_balls = [ball_of_symbol[symbol] for symbol in symbols]
        return cls(site_balls, cell[:, :d], positions[:, :d], **options)

    def repeat(self, shape: Any) -> Self:
        """Return the crystal whose cell is ``shape`` (L1, ..., Lp) cells of this crystal.

        Balls come in the order of cells, ball by ball of each cell, with the last period fastest.
        Raises :class:`~granphon.base.errors.InputError` for a crystal without periods, for a
        ``shape`` that is not p whole numbers from 1 to a million, and for more than ten million
        balls, or more than memory holds.
        """
        counts = self._read_shape(shape)
        _require_room(math.prod(counts), self)
        table = self.contacts
        n = self.n_balls
        cells, i, j, shift = repeat_contacts(table.i, table.j, table.shift, n, counts)
        origin = np.tile(np.arange(n), len(cells))
        rows = np.tile(np.arange(len(table)), len(cells))
        contacts = table.take(rows, i, j, shift)
        cell_origins = cells @ self.cell
        positions = (cell_origins[:, None] + self.positions).reshape(-1, self.dimension)
        supercell = self.cell * np.array(counts)[:, None]
        return self._take(origin, contacts, positions, cell=supercell)

    def _read_shape(self, shape: Any) -> tuple[int, ...]:
        """Return the numbers of cells (L1, ..., Lp) of a supercell, from the ``shape`` of
        :meth:`repeat`; the errors are those of :meth:`repeat`.
        """
        if not self.periods:
            problem = f"crystal {self.name!r} has no period along which it could be repeated"
            raise InputError(problem, mend="Give its cell")
        rule = partial(lengths, low=1, high=_MOST_CELLS, periods=self.periods)
        return tuple(require("shape", rule, shape))

    def sample(self, shape: Any = None, seed: int = 0, diameters: ArrayLike | None = None) -> Self:
        """Return a supercell whose balls have their own diameters: those given, or others drawn
        from the distributions that their kinds have as spreads.

        Parameters
        ----------
        shape : (L1, ..., Lp), numbers of cells along the periods; by default one cell.
        seed : the same seed gives the same diameters on any machine, and the same as in
            :class:`~granphon.DirectSimulation`. A larger sample contains the diameters of a smaller
            one, before their mean is shifted.
        diameters : (L1, ..., Lp), m, or (L1, ..., Lp, n) of n > 1 balls in the cell, instead of a
            ``shape``; ``seed`` then has no effect.

        The diameters of a kind are shifted so that their mean is the diameter of the kind, to
        rounding. They are assumed to differ little, as in a packing; this is not checked. All balls
        of a kind have the mass and the contact law of the mean ball, and mean balls touch at the
        reference sites. A contact of balls with the deviations D_i and D_j has the overlap
        (D_i + D_j)/2 there. In the state at rest some contacts are then open, and some balls may be
        loose. Means of forces and overlaps, as :meth:`at_force` takes them, are over all contacts
        of the sample, the open ones too.

        By default the cell of a crystal may shear (``boundary="stress"``) and contacts keep the
        directions of the sites. With ``boundary="isotropic"``, and ``finite_overlap`` as it is in
        the other state, the states are those of :class:`~granphon.DirectSimulation` of these balls.

        Raises :class:`~granphon.base.errors.InputError` for a ``shape`` that is not p whole numbers
        from 1 on, a ``seed`` that is no whole number from 0 to 2^64 - 1, and more balls than memory
        holds; for diameters of another shape, or with a ``shape``; for diameters that are not
        finite and above zero, also after the shift; and for crystals without a spread of which no
        diameters are given.
        """
        p = self.periods
        given_diameters = None
        if diameters is not None:
            given_diameters = read_diameters(diameters, p, self.n_balls)
            if shape is not None:
                problem = (
                    f"shape is {brief(shape)}, and diameters of the shape {given_diameters.shape}"
                    " are given too"
                )
                raise InputError(problem, mend="Give the diameters, and no shape")
            shape = given_diameters.shape[:p]
        elif not any(ball.spread for ball in self.kinds):
            raise InputError(
                f"no ball of crystal {self.name!r} has a spread of diameters",
                mend="Give one to a ball, as granphon.Ball(material, 8e-3, spread=...), or"
                " diameters",
            )
        # the shape of a cluster without periods is empty
        is_of_one_cell = shape is None or (not p and isinstance(shape, list | tuple) and not shape)
        counts = (1,) * p if is_of_one_cell else self._read_shape(shape)
        supercell = self.repeat(counts) if p else self
        if given_diameters is None:
            sizes = self._draw(supercell.kind, counts, seed)
        else:
            sizes = given_diameters.ravel()
        sample = supercell._derive(deviations=supercell._centre_sizes(sizes))
        if p == self.dimension and not self._flat_sides and self.on_site is None:
            # with the grid of its cells the sample comes to rest sooner, in the same state; the
            # grid takes the place of what the cached property of the frozen crystal would find
            vars(sample)["_grid"] = Grid.of(self.contacts, counts, self.n_balls)
        return sample

    def _centre_sizes(self, sizes: Array) -> Array:
        """Return the deviations (n,), m, from the ``sizes`` of the balls (n,), m: diameters, or
        deviations with any mean. The mean of each kind becomes zero.

        Raises :class:`~granphon.base.errors.InputError` for a ball whose diameter is then zero or
        below.
        """
        deviations = np.zeros_like(sizes)
        for number, ball in enumerate(self.kinds):
            is_of_kind = self.kind == number
            deviations_of_kind = subtract_mean(sizes[is_of_kind])
            deviations[is_of_kind] = deviations_of_kind
            least_diameter = ball.diameter + float(np.min(deviations_of_kind))
            if least_diameter <= 0.0:
                problem = f"the smallest ball has a diameter of {least_diameter:g} m"
                raise InputError(problem, mend="Give a smaller spread, or other diameters")
        return deviations

    def _draw(self, kind: Index, counts: tuple[int, ...], seed: int) -> Array:
        """Return the deviations (m,), m, with any mean, of the m balls of a supercell, whose kinds
        are ``kind`` (m,); zero of balls without a spread. ``counts`` are the numbers of cells along
        the periods, and ``seed`` is that of :meth:`sample`.
        """
        deviations = np.zeros(kind.size)
        n = self.n_balls
        sample_shape = (*counts, n) if n > 1 or not self.periods else counts
        for number, ball in enumerate(self.kinds):
            if ball.spread is not None:
                # drawn for all sites, also of other kinds, so that the diameter of a ball does not
                # depend on the kinds of the others
                deviations_of_sites = ball.spread.sample(sample_shape, seed).ravel()
                is_of_kind = kind == number
                deviations[is_of_kind] = deviations_of_sites[is_of_kind]
        return deviations

    def replace(self, index: Any, ball: Ball) -> Self:
        """Return the crystal with another ball at one site, or at several: a defect.

        ``index`` is the number of a ball, or a list of numbers, each once. The ball must have the
        radius of the kind that it replaces, to half a millionth, so that it touches the same
        neighbours. In a sample the new ball has the mean diameter of its kind. Other kinds keep
        their names; those with equal balls, as :meth:`with_balls` may make them, become one. A new
        kind whose ball has no name gets the next free letter.

        Raises :class:`~granphon.base.errors.InputError` for another radius, an argument that is no
        ball, an empty list, a number that no ball has or that is given twice, a name that another
        kind has, the name "floor", and a law that lacks a pair with the new kind.
        """
        sites = index_array("index", index, self.n_balls)
        site_balls = list(self.balls)
        if not isinstance(ball, Ball):
            raise InputError(f"{brief(ball)} is not a ball", mend="Give a granphon.Ball")
        for site in sites.tolist():
            radius = site_balls[site].radius
            if abs(ball.radius - radius) > 0.5 * TOUCH * ball.radius:
                raise InputError(
                    f"ball {site} has the radius {radius:.9g} m, and the new one"
                    f" {ball.radius:.9g} m",
                    "Its neighbours would overlap or miss it",
                    "Give a ball of the same size, or a new crystal from cell and positions",
                )
            site_balls[site] = ball
        kinds, kind = find_kinds(site_balls)
        known_names = dict(zip(self.kinds, self.names, strict=True))
        names = name_kinds(kinds, known_names)
        deviations = self.deviations
        if deviations is not None:
            is_replaced = np.isin(np.arange(self.n_balls), sites)
            deviations = np.where(is_replaced, 0.0, deviations)
        return self._derive(kinds=kinds, kind=kind, names=names, deviations=deviations)

    def with_balls(self, balls: Mapping[str, Ball]) -> Self:
        """Return the crystal with other balls of some kinds, by name, at the same positions. The
        kinds keep their names, whatever names the balls have.

        Raises :class:`~granphon.base.errors.InputError` for an argument that is no mapping of names
        to balls, a name without a kind, and a ball of another diameter.
        """
        kinds = dict(zip(self.names, self.kinds, strict=True))
        mapping: object = balls  # the caller may have given anything
        are_balls = isinstance(mapping, Mapping) and all(
            isinstance(ball, Ball) for ball in mapping.values()
        )
        if not are_balls:
            example = f'{{"{self.names[0]}": ball}}'
            mend = f"Give a granphon.Ball for each kind that changes, as {example}"
            raise InputError(f"the balls are {brief(mapping)}", mend=mend)
        for name, ball in balls.items():
            if name not in kinds:
                problem = f"there is no kind of ball {name!r}"
                raise InputError(problem, mend=f"Give one of {', '.join(kinds)}")
            diameter = kinds[name].diameter
            if ball.diameter != diameter:
                raise InputError(
                    f"balls {name!r} of {ball.diameter:g} m do not touch their neighbours where"
                    f" those of {diameter:g} m lie",
                    "Only on a named lattice places follow from diameters",
                    "Make the crystal anew",
                )
        changed_kinds = kinds | dict(balls)  # in the order of the names
        return self._derive(kinds=tuple(changed_kinds.values()))

    def with_springs(self, on_site: Any) -> Self:
        """Return the crystal with other springs to the ground: ``on_site`` are their stiffnesses
        (n, motions), N/m and N m, or has another form that the class takes; None for no springs.

        Raises :class:`~granphon.base.errors.InputError` for what the class refuses.
        """
        return self._derive(on_site=read_on_site(on_site, self.named_motions, self.n_balls))

    def with_walls(self, walls: Mapping[str, Wall]) -> Self:
        """Return the crystal with other ``walls``, by the names of those whose place they take, and
        which they keep: a name of their own is passed over, as in :meth:`with_balls`. A name that
        no wall has changes nothing.

        Raises :class:`~granphon.base.errors.InputError` for an argument that is no mapping of names
        to walls, and for a wall of the material of a kind that there is not.
        """
        mapping: object = walls  # the caller may have given anything
        are_walls = isinstance(mapping, Mapping) and all(
            isinstance(wall, Wall) for wall in mapping.values()
        )
        if not are_walls:
            mend = 'Give a granphon.Wall for each wall that changes, as {"wall": gp.Wall(steel)}'
            raise InputError(f"the walls are {brief(mapping)}", mend=mend)
        model = self.contact_model
        named_walls = {
            wall.name: replace(find_material(walls[wall.name], model.named_kinds), name=wall.name)
            for wall in model.walls
            if wall.name in walls
        }
        faces = tuple(
            replace(face, edges=replace_walls(face.edges, named_walls)) for face in self.faces
        )
        return self._derive(faces=faces)

    def remove(self, index: Any) -> Self:
        """Return the crystal without a ball, or without several: a vacancy. ``index`` is a number
        or a list of numbers, each once.

        Raises :class:`~granphon.base.errors.InputError` for an empty list, for a number that no
        ball has or that is given twice, and if no ball is left, a face has no ball left, or the
        balls that are left do not hang together.
        """
        is_remaining = np.ones(self.n_balls, bool)
        is_remaining[index_array("index", index, self.n_balls)] = False
        if not np.any(is_remaining):
            raise InputError("no ball is left", mend="Remove fewer")
        new_numbers = np.cumsum(is_remaining) - 1  # of the balls that remain
        table = self.contacts
        rows = np.flatnonzero(is_remaining[table.i] & is_remaining[table.j])
        i = new_numbers[table.i[rows]]
        j = new_numbers[table.j[rows]]
        contacts = table.take(rows, i, j, table.shift[rows])
        origin = np.flatnonzero(is_remaining)
        crystal = self._take(origin, contacts, self.positions[origin])
        crystal._require_joined("Remove it too")
        return crystal

    def cut(self, axis: Any, layers: int, edges: Any = "free") -> Self:
        """Return a number of layers of the crystal, a strip, slab or column, which does not repeat
        across its layers.

        Parameters
        ----------
        axis : index of the vector of the cell along which layers follow each other; or integer
            Miller indices of their plane, one for each vector of the cell as given, or four in a
            hexagonal cell. The cells of fcc, bcc, diamond and NaCl are primitive: the conventional
            plane (h, k, l) has the indices ``cell @ [h, k, l]``, made whole numbers, in these. So
            fcc's conventional (0, 0, 1) is (1, 1, 0), and (1, 1, 1) is (1, 1, 1).
        layers : the number of layers, each as thick as a cell.
        edges : how the two faces are held: "free"; "clamped", the outer layer does not move by
            itself, as beads that are glued to a wall; "floor", a rigid plane touches the outer
            balls; or a :class:`~granphon.Wall`, an elastic plane touches them. Give one edge for
            both faces, or (lower, upper).

        The layers follow each other along the first axis that is no longer a period, the lower face
        first: y of a crystal cut from a plane, z from space, x from a chain. If need be the crystal
        is turned, so that the periods that remain lie along x or in the xy plane. Where neither
        face is free, a load moves the upper one.

        Raises :class:`~granphon.base.errors.InputError` for an axis that is no period, a number of
        layers that is not whole and above zero or does not fit into memory, another edge, a wall of
        a kind that there is not or with a name that another has; if a ball touches no other and is
        at no floor, wall or clamp, layers do not hang together, or no balls touch; and if springs
        to the ground would lie across two axes.
        """
        count = whole_number("layers", layers, 1, _MOST_CELLS)
        _require_room(count, self)
        given_edges = require("edges", read_edges, edges)
        model = self.contact_model
        lower_edge, upper_edge = name_walls(given_edges, model.named_kinds, model.walls)
        face_edges = (lower_edge, upper_edge)
        layering = Layers.across(axis, self.cell)
        layers_alone = self._stack_layers(layering, count)
        normal_axis = self.periods - 1  # the last period becomes the axis across the layers
        heights = layers_alone.positions[:, normal_axis]
        face_balls = find_faces(heights, layers_alone._mean_radii, face_edges, self.n_balls)
        thickness = count * abs(float(layering.stack[normal_axis]))
        faces = Faces(normal_axis, thickness, face_edges, face_balls)
        crystal = layers_alone._derive(faces=(*self.faces, faces))
        crystal._require_joined("Give more layers")
        return crystal

    def _stack_layers(self, layering: Layers, count: int) -> Self:
        """Return ``count`` layers of the crystal, turned as the ``layering`` says, without the
        faces of this cut. The layers come from the lowest up.
        """
        n = self.n_balls
        table = self.contacts
        # the balls of one layer, and then the contacts within and between all layers
        sites, gathered_shift = layering.gather(self.positions, table.i, table.j, table.shift)
        i, j, rows, shift = layering.unfold(table.i, table.j, gathered_shift, n, count)
        contacts = table.take(rows, i, j, shift, layering.turn)
        # (count, n, d): the first layer, and the others above
        first_layer = sites @ layering.turn.T
        layer_positions = first_layer[None] + np.arange(count)[:, None, None] * layering.stack
        positions = layer_positions.reshape(-1, self.dimension)
        origin = np.tile(np.arange(n), count)
        crystal = self._take(origin, contacts, positions, cell=layering.cell)
        on_site = turn_on_site(crystal.on_site, layering.turn, self.named_motions)
        return crystal._derive(on_site=on_site)

    def _require_joined(self, mend_lone_ball: str) -> None:
        """Raise :class:`InputError` unless each face has a ball, there is a contact, each ball
        touches another or is at a floor, wall or clamp, and all hang together, also by way of
        these. Springs to the ground join no balls. ``mend_lone_ball`` says in the message how to
        mend that a ball touches no other.
        """
        n = self.n_balls
        table = self.contacts
        if not all(side.balls.size for side in self._sides):
            raise InputError(
                f"no ball is left at a face of crystal {self.name!r}",
                "It could be neither held nor pressed there",
                "Remove balls first, and cut then",
            )
        if not self.n_contacts:
            problem = f"no balls of crystal {self.name!r} touch"
            raise InputError(problem, mend="Give more layers, or remove fewer balls")
        # a floor, wall or clamp spans all periods and joins its balls
        is_at_support = np.zeros(n, bool)
        for side in self._sides:
            if side.edge != "free":
                is_at_support[side.balls] = True
        touching_balls = np.append(table.i, table.j)
        lone_balls = np.setdiff1d(np.flatnonzero(~is_at_support), touching_balls)
        if lone_balls.size:
            problem = f"ball {lone_balls[0]} of crystal {self.name!r} touches no other"
            raise InputError(problem, mend=mend_lone_ball)
        require_joined(
            table.i,
            table.j,
            table.shift,
            n,
            self.periods,
            f"crystal {self.name!r}",
            mend="Remove one of them, or give more layers",
            held=is_at_support,
        )

    # -- balls and contacts ------------------------------------------------------------------------

    @property
    def n_balls(self) -> int:
        """Number of balls in the cell."""
        return len(self.positions)

    @property
    def periods(self) -> int:
        """Number p of vectors along which the crystal repeats."""
        return len(self.cell)

    @property
    def dimension(self) -> int:
        """Dimension d of the space that holds the balls."""
        return int(self.positions.shape[1])

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The ball at each site."""
        return tuple(self.kinds[number] for number in self.kind.tolist())

    @property
    def n_contacts(self) -> int:
        """Number of contacts in the cell; contacts with floors and walls count, and come last."""
        return len(self.contacts) + sum(len(side.balls) for side in self._flat_sides)

    @property
    def measure(self) -> float:
        """Length, area or volume of the cell, m^p; 1 without a period."""
        return abs(float(np.linalg.det(self.cell[:, : self.periods]))) if self.periods else 1.0

    def __repr__(self) -> str:
        counts = np.bincount(self.kind, minlength=len(self.names)).tolist()
        kinds = ", ".join(f"{n} {name}" for n, name in zip(counts, self.names, strict=True))
        balls = f"{counted(self.n_balls, 'ball')} ({kinds})"
        contacts = counted(self.n_contacts, "contact")
        periods = counted(self.periods, "period")
        return f"Crystal({self.name!r}: {balls}, {contacts}, {periods}, {self.dimension}D)"

    @cached_property
    def radii(self) -> Array:
        """(n,) radii, m."""
        return read_only(self._mean_radii + self._bulges)

    @property
    def _mean_radii(self) -> Array:
        """(n,) radii of the mean balls of the kinds, m, with which they touch on the sites."""
        return np.array([ball.radius for ball in self.kinds])[self.kind]

    @property
    def _bulges(self) -> Array:
        """(n,) radii of the balls minus those of their kinds, m; zeros if none were drawn."""
        return np.zeros(self.n_balls) if self.deviations is None else 0.5 * self.deviations

    @property
    def mindlin_ratios(self) -> Array:
        """(n_c,) shear over normal stiffness of each contact, if it resists shear: 4 G*/E*. Where
        a law has a contact radius a of its own, as with adhesion, this is the shear stiffness over
        2 E* a.
        """
        return self._constants["mindlin_ratio"]

    @property
    def is_held(self) -> bool:
        """Whether a floor, a wall, a clamp or springs to the ground hold balls of the crystal."""
        return any(side.edge != "free" for side in self._sides) or self.is_anchored

    @property
    def is_anchored(self) -> bool:
        """Whether springs to the ground resist displacements of balls."""
        springs = self.on_site
        return springs is not None and bool(np.any(springs[:, self.named_motions.translating]))

    @property
    def downward(self) -> Array:
        """(d,) unit vector across the layers of the first cut with a face that is held, towards
        that face; towards the lower face if both are held. Without such a face the vector points
        down the last axis, along which each ball must have a spring to the ground.

        Raises :class:`~granphon.base.errors.InputError` if neither a face nor such springs hold the
        balls.
        """
        direction = np.zeros(self.dimension)
        for side in self._sides:  # the lower face comes first
            if side.edge != "free":
                direction[side.axis] = side.sign
                return direction
        if self.dimension - 1 in self._find_anchored_axes():
            direction[-1] = -1.0
            return direction
        error = InputError(
            f"nothing holds crystal {self.name!r} against gravity",
            mend='Cut it with a floor or clamp: c.cut(axis, layers, ("floor", "free"))',
        )
        error.block = ("load", "gravity")
        raise error

    def _take_least_of_ends(self, quantity: Array) -> Array:
        """Return (n_c,) for each contact the smaller of the two values that a ``quantity`` (n,) of
        balls has at its two ends; for a contact with a floor or wall, the value of the ball.
        """
        table = self.contacts
        between_balls = np.minimum(quantity[table.i], quantity[table.j])
        on_flat_sides = [quantity[side.balls] for side in self._flat_sides]
        return np.concatenate([between_balls, *on_flat_sides])

    @property
    def _contact_strengths(self) -> Array:
        """(n_c,) the smaller yield strength of the two bodies of each contact, Pa; a body whose
        strength is not known does not yield.
        """
        strengths = [ball.material.yield_strength for ball in self.kinds]
        of_kinds = np.array([math.inf if value is None else value for value in strengths])
        of_balls = self._take_least_of_ends(of_kinds[self.kind])
        no_wall = np.full(len(self.contacts), math.inf)  # of the contacts between balls
        on_walls = [np.full(len(side.balls), side.strength) for side in self._flat_sides]
        of_walls = np.concatenate([no_wall, *on_walls])
        return np.asarray(np.minimum(of_balls, of_walls))

    @cached_property
    def masses(self) -> Array:
        """(n,) masses, kg."""
        return read_only(np.array([ball.mass for ball in self.kinds])[self.kind])

    @cached_property
    def _sides(self) -> list[Side]:
        """The faces of all cuts, the lower before the upper of each."""
        sides = list[Side]()
        wall_count = 0
        for face in self.faces:
            lower_edge, upper_edge = face.edges
            lower_balls, upper_balls = face.balls
            upper_wall = -1
            if face.is_pressed:
                upper_wall = wall_count
                wall_count += 1
            sides.append(Side(face.axis, -1.0, lower_edge, lower_balls, -1))
            sides.append(Side(face.axis, 1.0, upper_edge, upper_balls, upper_wall))
        return sides

    @property
    def _flat_sides(self) -> list[Side]:
        """The faces that stand on a floor or wall, in the order of :attr:`_sides`."""
        return [side for side in self._sides if side.body is not None]

    @property
    def _flat_bodies(self) -> list[Body]:
        """The different flat bodies that balls touch: floors and walls."""
        return list(dict.fromkeys(side.body for side in self._flat_sides if side.body is not None))

    @cached_property
    def _pairs(self) -> tuple[list[tuple[Body, Body, str, str]], Index]:
        """The different pairs of kinds that touch, and the number (n_c,) of the pair of each
        contact. Floors and walls count as kinds. A pair has four entries: the two bodies, and their
        names.
        """
        bodies: list[Body] = [*self.kinds, *self._flat_bodies]
        names = [*self.names, *(body.name for body in self._flat_bodies)]
        lower_kind, higher_kind = self._find_kinds_of_ends()
        # one whole number for each pair of kinds
        keys, pair_of_contact = np.unique(
            lower_kind * len(bodies) + higher_kind, return_inverse=True
        )
        pairs = []
        for key in keys.tolist():
            first, second = divmod(key, len(bodies))
            pairs.append((bodies[first], bodies[second], names[first], names[second]))
        return pairs, pair_of_contact.astype(np.intp)

    def _find_kinds_of_ends(self) -> tuple[Index, Index]:
        """Return the numbers (n_c,) of the kinds of the two bodies of each contact, the lower
        number first. The numbers of floors and walls, in the order of :attr:`_flat_bodies`, follow
        those of the kinds of balls.
        """
        table = self.contacts
        flat_bodies: list[Body | None] = [*self._flat_bodies]
        kinds_i = self.kind[table.i]
        kinds_j = self.kind[table.j]
        lower_kinds = [np.minimum(kinds_i, kinds_j)]
        higher_kinds = [np.maximum(kinds_i, kinds_j)]
        for side in self._flat_sides:
            number = len(self.kinds) + flat_bodies.index(side.body)
            lower_kinds.append(self.kind[side.balls])
            higher_kinds.append(np.full(len(side.balls), number))
        return np.concatenate(lower_kinds), np.concatenate(higher_kinds)

    @cached_property
    def _laws(self) -> ContactLaws:
        """The law of each contact."""
        pairs, pair_of_contact = self._pairs
        laws: list[PairLaw] = []
        checked_laws: set[int] = set()  # by their identity
        for first, second, first_name, second_name in pairs:
            law = law_of_pair(self.law, first, second, first_name, second_name)
            if id(law) not in checked_laws:  # a user's law of many pairs is checked once
                check_law(law, ContactConstants.of(first, second).radius)
                checked_laws.add(id(law))
            laws.append(law)
        # the numbers of the contacts of each pair: contacts are sorted by pairs, and split there
        order = np.argsort(pair_of_contact, kind="stable")
        starts = np.searchsorted(pair_of_contact[order], np.arange(1, len(pairs)))
        contacts_of_pairs = np.split(order, starts)[: len(pairs)]  # one part also of no pairs
        groups = list(zip(laws, contacts_of_pairs, strict=True))
        return ContactLaws(groups, len(pair_of_contact), self._constants["modulus"])

    def law_of(self, i: int, j: int) -> tuple[PairLaw, float, float]:
        """Return the law of a contact of the bodies i and j, its ratio 4 G*/E*, zero without
        friction, and E*, Pa.

        The numbers below n are those of the balls. The next numbers are those of the faces that
        stand on a floor or wall, in their order; any larger number is a rigid floor. Raises
        :class:`~granphon.base.errors.InputError` for a number that is not whole or below zero, for
        two bodies that are no balls, and for two kinds of which the law lacks the pair.
        """
        whole_number("i", i, 0)
        whole_number("j", j, 0)
        return self.contact_model.law_of(self._find_kind_name(i), self._find_kind_name(j))

    def _find_kind_name(self, number: int) -> str:
        """Return the name of the kind of the body with a ``number`` of :meth:`law_of`: a ball, a
        wall or a rigid floor.
        """
        if number < self.n_balls:
            return self.names[int(self.kind[number])]
        bodies: list[Body] = [side.body or RIGID_PLANE for side in self._flat_sides]
        index = number - self.n_balls
        return bodies[index].name if index < len(bodies) else RIGID_PLANE.name

    def touch(self) -> CrystalState:
        """Return the state in which balls just touch, with zero stress, strain and displacements.

        The overlaps are 1e-6 of the distances of the two bodies of a contact, and the forces and
        stiffnesses are those at these overlaps: at zero overlap most laws have no stiffness. In a
        sample too it is the mean balls that touch.

        Raises :class:`~granphon.base.errors.InputError` if balls have a spread, and none are drawn.
        """
        assembly = self._assembly
        laws = self._laws
        overlap = TOUCH * self._distance
        d = self.dimension
        p = self.periods
        return CrystalState(
            crystal=self,
            normal_force=laws.force(overlap),
            overlap=overlap,
            normal_stiffness=laws.stiffness(overlap),
            normal=assembly.normal[: self.n_contacts, :d],
            displacements=np.zeros((self.n_balls, d)),
            stress=np.zeros((p, p)),
            strain=np.zeros((p, p)),
            ways=np.zeros(assembly.n_walls),
        )

    @property
    def _distance(self) -> Array:
        """(n_c,) distances of the two bodies of each contact at touch, m."""
        return self._assembly.distance[: self.n_contacts]

    @cached_property
    def contact_model(self) -> ContactModel:
        """The kinds and the laws of their contacts, for networks of the crystal."""
        walls = tuple(body for body in self._flat_bodies if isinstance(body, Wall))
        return ContactModel(
            self.kinds,
            self.names,
            self.law,
            self.friction,
            self.torsion,
            self.bending,
            walls=walls,
        )

    @cached_property
    def _constants(self) -> dict[str, Array]:
        """The constants (n_c,) of all contacts by their names in
        :class:`~granphon.balls.ball.ContactConstants`, where their units are given.
        """
        pairs, pair_of_contact = self._pairs
        constants = [ContactConstants.of(first, second) for first, second, _, _ in pairs]
        columns = np.reshape(constants, (-1, len(ContactConstants._fields)))[pair_of_contact].T
        return dict(zip(ContactConstants._fields, map(read_only, columns), strict=True))

    @cached_property
    def ball_motions(self) -> Motions:
        """The motions of each ball, without rotations if no contact and no spring to the ground
        resists any.
        """
        # only whether these stiffnesses are zero matters; torsion may be the word "mindlin"
        mindlin_ratio = 1.0 if self.friction else 0.0
        torsion = 1.0 if self.torsion else 0.0
        return select_motions(
            mindlin_ratio, torsion, self.bending, self.named_motions, self.on_site
        )

    @property
    def named_motions(self) -> Motions:
        """The motions that :attr:`motions` names."""
        return find_motions(self.dimension, self.motions)

    @cached_property
    def _springs(self) -> tuple[Index, Index, Array]:
        """The springs to the ground against displacements of balls that move by themselves: the
        ball (n_s,), the axis (n_s,) and the stiffness (n_s,), N/m, of each of the n_s springs.
        """
        if self.on_site is None:
            no_numbers = np.zeros(0, np.intp)
            return no_numbers, no_numbers, np.zeros(0)
        axes = np.array(self.named_motions.translations)
        # balls come to rest in d dimensions: displacements out of the plane are not among them
        columns_of_axes = np.flatnonzero(axes < self.dimension)
        springs = np.where(
            self._bodies.ball_number[:, None] >= 0, self.on_site[:, columns_of_axes], 0.0
        )
        balls, columns = np.nonzero(springs)
        return balls, axes[columns_of_axes][columns], springs[balls, columns]

    def _find_anchored_axes(self) -> set[int]:
        """Return the axes along which each ball that moves by itself has a spring to the ground."""
        _, axes, _ = self._springs
        n_moving = self._bodies.n_balls
        return {axis for axis in range(self.dimension) if np.sum(axes == axis) == n_moving}

    @cached_property
    def _assembly(self) -> Assembly:
        """What comes to rest: balls, walls, the cell, and their contacts. Contacts between balls
        come first, then those with floors and walls, and springs to the ground, as contacts, last.

        Raises :class:`~granphon.base.errors.InputError` if balls have a spread, and none are drawn.
        """
        self._require_drawn()
        bodies = self._bodies
        d = self.dimension
        rows = [self._list_ball_rows(), *map(self._list_flat_rows, self._flat_sides)]
        rows.append(self._list_spring_rows())
        # the columns of all rows, each in one array
        columns = _Rows(*(np.concatenate(column) for column in zip(*rows, strict=True)))
        vector = np.zeros((len(columns.vector), 3))
        vector[:, :d] = columns.vector
        # one law for all springs of the same stiffness, with the numbers of these springs
        _, _, constants = self._springs
        spring_laws = [
            (SpringLaw(constant), np.flatnonzero(constants == constant))
            for constant in np.unique(constants).tolist()
        ]
        axes = [face.axis for face in bodies.walls]
        return Assembly(
            n_balls=bodies.n_balls,
            i=columns.i.astype(np.int64),
            j=columns.j.astype(np.int64),
            vector=vector,
            is_flat=np.arange(len(vector)) >= len(self.contacts),  # all but those between balls
            offset=columns.offset,
            laws=self._laws.append(spring_laws, len(constants)),
            cell=self.cell[:, : self.periods],
            dimension=d,
            directions=np.eye(d)[axes].reshape(len(axes), d),  # also with no wall that moves
            wall_balls=np.array([float(len(face.balls[1])) for face in bodies.walls]),
        )

    def _list_ball_rows(self) -> _Rows:
        """Return the contacts between balls; their offsets are the overlaps that drawn balls have
        at the positions at which the mean balls touch.
        """
        table = self.contacts
        body_of_ball = self._bodies.body_of_ball
        offset = self._bulges[table.i] + self._bulges[table.j]
        return _Rows(body_of_ball[table.i], body_of_ball[table.j], table.vector, offset)

    def _list_flat_rows(self, side: Side) -> _Rows:
        """Return the contacts with the floor or wall at a ``side``; their vectors lead from the
        centre of the ball to the flat body.
        """
        bodies = self._bodies
        n = len(side.balls)
        flat_body = bodies.n_balls + side.wall if side.wall >= 0 else bodies.held_body
        radii = self._mean_radii[side.balls]
        vector = side.sign * radii[:, None] * np.eye(self.dimension)[side.axis]
        return _Rows(
            bodies.body_of_ball[side.balls],
            np.full(n, flat_body),
            vector,
            self._bulges[side.balls],
        )

    def _list_spring_rows(self) -> _Rows:
        """Return the springs to the ground as contacts with what is held."""
        bodies = self._bodies
        balls, axes, _ = self._springs
        return _Rows(
            bodies.body_of_ball[balls],
            np.full(len(balls), bodies.held_body),
            _SPRING_LENGTH * np.eye(self.dimension)[axes],
            np.zeros(len(balls)),
        )

    @cached_property
    def _grid(self) -> Grid | None:
        """The contacts of a sample on the grid of its cells, kind by kind: :meth:`sample` sets
        this attribute. None of other crystals.
        """
        return None

    @cached_property
    def _sample_on_grid(self) -> SampleOnGrid | None:
        """The assembly on the grid of cells of a sample whose contacts all have one law of Hertz;
        None of other crystals.
        """
        groups = self._laws.groups
        if self._grid is None or len(groups) != 1 or not isinstance(groups[0][0], HertzLaw):
            return None
        return SampleOnGrid.of(self._assembly, self._grid, groups[0][0])

    def _find_rest(
        self,
        load: AppliedLoad,
        geometry: Geometry,
        boundary: Boundary,
        start: Rest | None = None,
    ) -> Rest:
        """Return the state at rest under a ``load``, found from the state ``start`` if given; for
        the ``geometry`` of contacts and the ``boundary`` see
        :func:`~granphon.statics.find_rest.find_rest`.

        A sample on a grid is solved with its balls in the order of the grid, where solvers of grids
        serve, and its state is put back into the order of the crystal. If forces act on single
        balls, it is solved in the order of the crystal.
        """
        sample_on_grid = self._sample_on_grid
        try:
            if sample_on_grid is None or np.any(load.force):
                return find_rest(self._assembly, load, geometry, boundary, start)
            start_on_grid = None if start is None else sample_on_grid.sort(start)
            on_grid = find_rest(sample_on_grid.assembly, load, geometry, boundary, start_on_grid)
        except ConvergenceError as error:
            error.reached = None  # it is no state of the crystal
            raise
        return sample_on_grid.restore(on_grid)

    def _require_drawn(self) -> None:
        """Raise :class:`InputError` if balls have a spread of diameters, and none are drawn."""
        spreads = [ball.spread for ball in self.kinds if ball.spread is not None]
        if self.deviations is None and any(spread.rms for spread in spreads):
            problem = (
                f"balls of crystal {self.name!r} have a spread of diameters, and none are drawn"
            )
            why = "Each ball is simulated by itself"
            raise InputError(problem, why, "Draw them: crystal.sample((8, 8), seed=0)")

    @cached_property
    def _bodies(self) -> _Bodies:
        """What moves in the statics. Balls of a clamped layer do not move by themselves."""
        wall_of_ball = np.full(self.n_balls, -1, np.intp)
        is_free = np.ones(self.n_balls, bool)
        for side in self._sides:
            if side.edge == "clamped":
                is_free[side.balls] = False
                wall_of_ball[side.balls] = side.wall
        ball_number = np.full(self.n_balls, -1, np.intp)
        ball_number[is_free] = np.arange(np.count_nonzero(is_free))
        walls = [face for face in self.faces if face.is_pressed]
        return _Bodies(ball_number, walls, wall_of_ball)

    # -- under load --------------------------------------------------------------------------------

    def at_pressure(
        self,
        pressure: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
        boundary: Boundary = "stress",
    ) -> CrystalState:
        """Return the state at rest under a hydrostatic pressure.

        Parameters
        ----------
        pressure : P, Pa in space, N/m in the plane, N on a line; one value or an array. On a cut
            crystal P also acts on both faces; on a free face the outer balls share it equally.
        gravity : (d,) the acceleration, m/s^2, of a crystal that a floor, a wall, a clamp or
            springs to the ground hold, or (..., d) for one acceleration at each load; zeros are no
            gravity. On a line a number will do. With gravity the periods keep the length at which
            balls touch, as between walls; P acts on the faces alone, and may be zero.
        finite_overlap : the true geometry: contacts turn, the cell deforms, P acts on the deformed
            cell, and static forces enter the response. By default contacts keep the directions of
            the sites, and overlaps are small, which drops terms of relative order delta/d.
        boundary : "stress" (the default of crystals): the whole stress of the periods is
            hydrostatic, and the cell takes the shape that this asks for. "isotropic" (as in
            :class:`~granphon.DirectSimulation`): the cell keeps its shape and takes the size at
            which the mean of its principal stresses is -P; the stress of a sample need not be
            hydrostatic then.

        Raises
        ------
        InputError : a pressure of zero or below (with gravity zero is allowed; where contacts
            adhere or are bonds every pressure is), a pressure on a crystal without periods and
            faces, gravity of another shape, or that nothing holds, numbers that are not finite,
            forces that contacts cannot bear or that are beyond double precision, balls that overlap
            by their diameter or more, another boundary, a ``finite_overlap`` that is not true,
            false or None; kinds with a spread of diameters of which none are drawn.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        MechanismError : in the true geometry, balls differ and some motions cost no energy.
        """
        values, accelerations = self._read_gravity(finite_array("pressure", pressure), gravity)
        if np.any(values):
            self._require_pressable()
        adhere = self._laws.can_adhere
        if np.any(values < 0.0) and not adhere:
            problem = f"pressure is {brief(values.tolist())}: tensile"
            raise InputError(problem, NO_TENSION, "Give a pressure above zero")
        loads = list(zip(values.ravel().tolist(), accelerations, strict=True))
        if not adhere and any(
            value == 0.0 and acceleration is None for value, acceleration in loads
        ):
            mend = "Press them, or give gravity and a floor"
            raise InputError("pressure is zero", NO_STIFFNESS, mend)
        applied = (
            self._load_hydrostatic(value, acceleration, f"a pressure of {value:g}")
            for value, acceleration in loads
        )
        return self._solve_each(values, applied, finite_overlap, boundary=boundary)

    def at_force(
        self,
        force: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
        boundary: Boundary = "stress",
    ) -> CrystalState:
        """Return the state at rest under the hydrostatic pressure at which contacts carry the mean
        ``force``, N.

        The mean is taken over the contacts that carry a load, or touch if they adhere; of balls
        that differ in diameter, over all contacts. ``gravity``, ``finite_overlap``, ``boundary``
        and the errors are as in :meth:`at_pressure`. But a mean of zero or below is always an
        InputError; and so is a mean that contacts have at no pressure, as where the mean is larger
        under gravity alone.
        """
        return self._at_mean("force", force, gravity, finite_overlap, boundary)

    def at_overlap(
        self,
        overlap: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
        boundary: Boundary = "stress",
    ) -> CrystalState:
        """Return the state at rest under the hydrostatic pressure at which contacts have the mean
        ``overlap``, m. ``gravity``, ``finite_overlap``, ``boundary`` and the errors are as in
        :meth:`at_force`.
        """
        return self._at_mean("overlap", overlap, gravity, finite_overlap, boundary)

    def at_stress(
        self,
        stress: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
    ) -> CrystalState:
        """Return the state at rest under a stress; tension is positive.

        Parameters
        ----------
        stress : (p, p) symmetric, or Voigt: (1,), (3,) for xx, yy, xy or (6,) for xx, yy, zz, yz,
            xz, xy; or an array of these. With one period a number will do. Pa in space, N/m in the
            plane, N on a line. Of a crystal that was cut, the stress acts along the periods that
            remain, and the faces are not pressed.
        gravity : m/s^2, as in :meth:`at_pressure`; the periods take the stress all the same.
        finite_overlap : see :meth:`at_pressure`; the stress is then Cauchy's, on the deformed cell.

        Raises
        ------
        InputError : an array of another shape, a matrix that is not symmetric, a crystal without
            periods; a stress that contacts cannot bear, because they only push along the lines of
            their centres, or under which no contact has a stiffness, as a stress of zero; gravity,
            balls and spreads as in :meth:`at_pressure`.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        MechanismError : in the true geometry, balls differ and some motions cost no energy.
        """
        tensors = self._read_tensor("stress", stress, 1.0)
        values, accelerations = self._read_gravity(tensors, gravity, 2)

        def describe(tensor: Array) -> str:
            """Return a stress (p, p) in words."""
            # digits of rounding are not shown, unless the stress is as small as they are
            shown_tensor = np.round(tensor, 12) if np.max(np.abs(tensor)) > 1e-6 else tensor
            return f"the stress {brief(shown_tensor.tolist())} {_PRESSURE_UNITS[self.periods]}"

        loads = zip(values.reshape(-1, *values.shape[-2:]), accelerations, strict=True)
        applied = (
            self._load(describe(tensor), acceleration, stress=tensor)
            for tensor, acceleration in loads
        )
        return self._solve_each(values, applied, finite_overlap, 2)

    def at_strain(
        self,
        strain: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
    ) -> CrystalState:
        """Return the state at rest of a crystal whose periods are strained; extension is positive.

        Parameters
        ----------
        strain : (p, p) symmetric, or Voigt with twice the shear: (1,), (3,) for xx, yy, 2xy or (6,)
            for xx, yy, zz, 2yz, 2xz, 2xy; or an array of these. With one period a number will do.
            Strain is measured from the cell in which balls only touch.
        gravity, finite_overlap : see :meth:`at_stress`; the periods keep the strain.

        Raises
        ------
        InputError : an array of another shape, a matrix that is not symmetric, a crystal without
            periods; a strain under which all contacts are open or only touch, or that shortens the
            cell to nothing along any direction; gravity, balls and spreads as in
            :meth:`at_pressure`.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        MechanismError : in the true geometry, balls differ and some motions cost no energy.
        """
        tensors = self._read_tensor("strain", strain, 0.5)
        values, accelerations = self._read_gravity(tensors, gravity, 2)
        least_strain = float(np.min(np.linalg.eigvalsh(values)))
        if least_strain <= -1.0:
            problem = f"strain shortens crystal {self.name!r} by {-least_strain:.4g} of its length"
            raise InputError(problem, "Nothing would be left of it", "Give a strain above -1")

        loads = zip(values.reshape(-1, *values.shape[-2:]), accelerations, strict=True)
        applied = (
            self._load(f"the strain {brief(tensor.tolist())}", acceleration, strain=tensor)
            for tensor, acceleration in loads
        )
        return self._solve_each(values, applied, finite_overlap, 2)

    def _read_tensor(self, name: str, tensor: ArrayLike, shear_factor: float) -> Array:
        """Return symmetric tensors (..., p, p) from a ``tensor`` of that shape, or from its
        components in Voigt's order, (..., p (p + 1)/2). With one period a number is a tensor too.

        Shears among the components are multiplied by ``shear_factor``: 1 of a stress, 1/2 of a
        strain. ``name`` is what messages call the tensor. Raises InputError for other shapes, for
        numbers that are not finite, for tensors that are not symmetric, and for a crystal without
        periods.
        """
        p = self.periods
        if not p:
            problem = f"crystal {self.name!r} has no period that a {name} could act on"
            raise InputError(problem, mend="Give a pressure")
        components = finite_array(name, tensor)
        voigt = voigt_pairs(p)
        if p == 1 and components.ndim == 0:
            components = components[None]
        if components.shape[-2:] == (p, p):
            asymmetry = np.abs(components - np.swapaxes(components, -1, -2))
            sizes = np.max(np.abs(components), axis=(-2, -1), keepdims=True)  # of each tensor
            if np.any(asymmetry > _ROUNDING * sizes):
                raise InputError(f"{name} is not symmetric", mend="Give a symmetric matrix")
            return components
        if components.shape[-1:] != (len(voigt),):
            problem = f"{name} has the shape {components.shape}"
            mend = f"Give ({p}, {p}), or ({len(voigt)},) in Voigt order, or an array of these"
            raise InputError(problem, mend=mend)
        tensors = np.zeros((*components.shape[:-1], p, p))
        for number, (a, b) in enumerate(voigt):
            factor = 1.0 if a == b else shear_factor
            tensors[..., a, b] = components[..., number] * factor
            tensors[..., b, a] = tensors[..., a, b]
        return tensors

    def _read_gravity(
        self, values: Array, gravity: ArrayLike | None, rank: int = 0
    ) -> tuple[Array, list[Array | None]]:
        """Return the ``values`` of loads broadcast with gravity, and a list of the acceleration
        (d,), m/s^2, at each load, None where there is no gravity or gravity is zero.

        The last ``rank`` axes of ``values`` belong to one load. Raises InputError for gravity of
        another shape, or that nothing holds.
        """
        load_shape = values.shape[: values.ndim - rank]
        tensor_shape = values.shape[len(load_shape) :]
        if gravity is None:
            return values, [None for _ in range(math.prod(load_shape))]
        field = finite_array("gravity", gravity)
        d = self.dimension
        if d == 1 and field.shape[-1:] != (1,):  # numbers along a line need no axis of components
            field = field[..., None]
        common_shape = None
        if field.shape[-1:] == (d,):
            with suppress(ValueError):  # of shapes that do not broadcast
                common_shape = np.broadcast_shapes(load_shape, field.shape[:-1])
        if common_shape is None:
            loads = f", and the loads {load_shape}" if load_shape else ""
            problem = f"gravity has the shape {field.shape}{loads}"
            mend = f"Give its {counted(d, 'component')}, m/s^2, as (0, -9.81) in a plane"
            raise InputError(problem, mend=mend)
        self._require_standing(field)
        field_of_loads = np.broadcast_to(field, (*common_shape, d)).reshape(-1, d)
        values_of_loads = np.broadcast_to(values, common_shape + tensor_shape)
        accelerations = [vector if np.any(vector) else None for vector in field_of_loads]
        return values_of_loads, accelerations

    def _require_standing(self, field: Array) -> None:
        """Raise :class:`InputError` for gravity ``field`` (..., d), m/s^2, along an axis on which
        nothing holds the balls; along a period only springs to the ground can.
        """
        d = self.dimension
        largest_component = np.max(np.abs(field), axis=-1, keepdims=True)
        is_acting = np.abs(field) > _ROUNDING * largest_component
        acting_axes = np.flatnonzero(np.any(is_acting.reshape(-1, d), axis=0)).tolist()
        held_axes = {side.axis for side in self._sides if side.edge != "free"}
        anchored_axes = self._find_anchored_axes()
        has_clamp = any("clamped" in face.edges for face in self.faces)
        for axis in acting_axes:
            is_period = axis < self.periods
            is_held = axis in held_axes or has_clamp  # a clamp holds along all axes
            # along a period a face holds nothing, as balls repeat there; springs hold there too
            if axis in anchored_axes or (is_held and not is_period):
                continue
            reason = "repeats" if is_period else "stands on nothing"
            raise InputError(
                f"gravity acts along {'xyz'[axis]}, where crystal {self.name!r} {reason}",
                "Nothing holds the balls there",
                'Cut it, and let it stand: crystal.cut(axis, layers, edges=("floor", "free"))',
            )

    def _load(
        self,
        words: str,
        acceleration: Array | None,
        stress: Array | None = None,
        strain: Array | None = None,
        pressure: float = 0.0,
    ) -> AppliedLoad:
        """Return the load of gravity, of the periods, and of a ``pressure`` on the faces.

        Gravity is an ``acceleration`` (d,), m/s^2, or None. The periods have a ``stress`` or a
        ``strain`` (p, p), exactly one of which is given. The units are those of
        :meth:`at_pressure` and :meth:`at_strain`. Messages call the load by ``words``.

        Raises FloatingPointError if the forces are not finite.
        """
        pressing_force = self._press_faces(pressure)
        force = pressing_force.copy()
        lift: tuple[str, str] | None = None  # why gravity lifts balls, and what mends that
        if acceleration is not None:
            masses = self.masses[self._bodies.ball_number >= 0]
            force[: masses.size * self.dimension] += (masses[:, None] * acceleration).ravel()
            lift = self._explain_lift(acceleration, pressure)
        if not np.all(np.isfinite(force)):
            raise FloatingPointError(f"the forces of {words} are not finite")
        strain_of_cell = np.zeros((self.periods,) * 2) if strain is None else strain
        return AppliedLoad(force, words, stress, strain_of_cell, pressing_force, lift)

    def _press_faces(self, pressure: float) -> Array:
        """Return the forces, N, of a pressure: the d components of each ball that moves by itself,
        ball by ball, and then one force on each wall that moves. The balls of a free face share
        the force on the face equally.
        """
        assembly = self._assembly
        ball_number = self._bodies.ball_number
        on_balls = np.zeros((assembly.n_balls, self.dimension))
        on_walls = np.zeros(assembly.n_walls)
        for side in self._sides:
            thicknesses = [face.thickness for face in self.faces if face.axis != side.axis]
            face_force = pressure * assembly.measure * math.prod(thicknesses)
            if side.wall >= 0:
                on_walls[side.wall] -= face_force
            elif side.edge == "free":
                numbers = ball_number[side.balls]
                moving_numbers = numbers[numbers >= 0]
                # all balls of the face may belong to a clamped layer: none takes a force then
                ball_force = side.sign * face_force / max(len(moving_numbers), 1)
                on_balls[moving_numbers, side.axis] -= ball_force
        return np.concatenate([on_balls.ravel(), on_walls])

    def _explain_lift(self, acceleration: Array, pressure: float) -> tuple[str, str] | None:
        """Return why gravity, an ``acceleration`` (d,), m/s^2, lifts balls off the face of a cut on
        which they stand, and what mends that, both in words.

        Return None if gravity lifts them off no face. It does not if the ``pressure`` is larger
        than their weight, if both faces of the cut are clamped, or if both are free, so that
        balls stand on neither.
        """
        for face in self.faces:
            if face.edges in (("free", "free"), ("clamped", "clamped")):
                continue
            low, high = face.edges
            stands_on_low = low != "free"
            component = float(acceleration[face.axis])
            # m/s^2, away from the face that holds
            lift = component if stands_on_low else -component
            weight_pressure = self._weigh_on(face, lift)
            if lift <= 0.0 or pressure > weight_pressure:
                continue
            unit = _PRESSURE_UNITS[self.periods + len(self.faces)]
            support = _name_support(low if stands_on_low else high)
            sign = "" if stands_on_low else "-"
            why = (
                f"Gravity acts along {sign}{'xyz'[face.axis]}, away from the {support} on which"
                f" the balls stand"
            )
            press = f"press with more than their weight, {weight_pressure:.4g} {unit}"
            return why, f"Turn it round, or {press}"
        return None

    def _weigh_on(self, face: Faces, acceleration: float) -> float:
        """Return the pressure, N, N/m or Pa, that the weight of all balls that move by themselves
        exerts on a ``face`` of a cut, under an ``acceleration``, m/s^2, across the face.
        """
        mass = float(np.sum(self.masses[self._bodies.ball_number >= 0]))
        other_thicknesses = [cut.thickness for cut in self.faces if cut is not face]
        return mass * acceleration / (self.measure * math.prod(other_thicknesses))

    def _load_hydrostatic(
        self, pressure: float, acceleration: Array | None, words: str
    ) -> AppliedLoad:
        """Return the load of a ``pressure`` on periods and faces. With gravity, an
        ``acceleration`` (d,), m/s^2, the periods keep their length.

        ``words`` say in messages what the load is. They end with the pressure without its unit;
        the unit is added here.
        """
        words += f" {_PRESSURE_UNITS[self.periods + len(self.faces)]}"
        if acceleration is not None:
            words = f"{words} with gravity"
            strain = np.zeros((self.periods,) * 2)
            return self._load(words, acceleration, strain=strain, pressure=pressure)
        # the stress of a layer is that of its whole thickness
        thickness = math.prod(face.thickness for face in self.faces)
        stress = -pressure * np.eye(self.periods) * thickness
        return self._load(words, None, stress, pressure=pressure)

    def _at_mean(
        self,
        kind: str,
        values: ArrayLike,
        gravity: ArrayLike | None,
        finite_overlap: bool | None,
        boundary: Boundary,
    ) -> CrystalState:
        """Return the state at which the mean force (``kind`` "force") or the mean overlap
        ("overlap") of contacts has each of the ``values``, N or m.

        The pressure is searched for. The other arguments and the errors are those of
        :meth:`at_force`.
        """
        goals, accelerations = self._read_gravity(finite_array(kind, values), gravity)
        self._require_pressable()
        if np.any(goals <= 0.0):
            is_tensile = bool(np.any(goals < 0.0))
            sign = f"{brief(goals.tolist())}: tensile" if is_tensile else "zero"
            why = NO_TENSION if is_tensile else NO_STIFFNESS
            mend = f"Give a {kind} above zero"
            if self._laws.can_adhere:
                why = "A mean of contacts that adhere belongs to no single pressure there"
                mend = "Use at_pressure, which may be zero or below"
            raise InputError(f"{kind} is {sign}", why, mend)
        is_exact = read_finite_overlap(finite_overlap)
        require("boundary", partial(choice, options=BOUNDARIES), boundary)
        with _in_double_precision(goals):
            loads = zip(goals.ravel().tolist(), accelerations, strict=True)
            solutions = [
                self._find_mean(
                    MeanGoal(kind, goal), acceleration, is_exact=is_exact, boundary=boundary
                )
                for goal, acceleration in loads
            ]
            return self._stack(goals, solutions, 0, is_exact)

    def _require_pressable(self) -> None:
        """Raise :class:`InputError` if there is neither a period nor a face to press on."""
        if not (self.periods or self.faces):
            problem = f"crystal {self.name!r} has neither periods nor faces to press on"
            raise InputError(problem, mend="Give a cell")

    def _find_mean(
        self,
        goal: MeanGoal,
        acceleration: Array | None,
        *,
        is_exact: bool,
        boundary: Boundary,
    ) -> tuple[Rest, AppliedLoad]:
        """Return the state at rest at which the mean of contacts is the ``goal``, and its load.

        ``acceleration`` (d,), m/s^2, is gravity, or None. With ``is_exact`` contacts turn and the
        cell deforms. ``boundary`` is that of :meth:`at_pressure`. The search for the pressure is
        that of :class:`~granphon.media.mean_force.PressureSearch`.

        Raises InputError if all contacts are open, or if the mean is not reached: contacts have it
        at no pressure, or :data:`MOST_MEANS` trials do not come to it.
        """
        laws = self._laws
        balls_differ = self._assembly.has_offsets
        has_gravity = acceleration is not None
        next_pressure = self._estimate_pressure(goal)
        search = PressureSearch(
            goal,
            balls_differ=balls_differ,
            contacts_adhere=laws.can_adhere,
            has_gravity=has_gravity,
        )
        start: Rest | None = None
        state: Rest | None = None
        for _ in range(MOST_MEANS):
            pressure = next_pressure
            words = f"a {goal}, at a pressure of {pressure:.6g}"
            load = self._load_hydrostatic(pressure, acceleration, words)
            lattice_state = self._find_rest(load, "lattice", boundary, start)
            if is_exact:
                state = self._find_exact(load, boundary, lattice_state, state)
            else:
                state = lattice_state
            contacts = MeanContacts.of(state, laws, balls_differ)
            contacts.require_any(goal, load.words, laws.can_adhere)
            mean = contacts.find_mean(goal.kind)
            rounding = contacts.bound_rounding(goal, balls_differ, laws.can_adhere)
            if search.is_reached(mean, rounding):
                return state, load
            if has_gravity and search.is_stuck(mean, rounding):
                break  # gravity alone presses more than the goal
            guess, overlap_growth = search.find_next(contacts, pressure, mean)
            if guess is None:
                if search.last_error <= rounding:
                    return state, load
                break
            # the next state is found from this one with the overlaps that are expected there
            start = lattice_state.scale(overlap_growth)
            next_pressure = guess
        raise self._explain_unreached_mean(goal, pressure, mean, has_gravity)

    def _find_exact(
        self, load: AppliedLoad, boundary: Boundary, lattice_state: Rest, last_state: Rest | None
    ) -> Rest:
        """Return the state at rest in the exact geometry under a ``load``, found from the
        ``lattice_state``, that in the directions of the sites. Where balls differ it is found from
        the ``last_state`` in the exact geometry, if there is one: from another state loose balls
        would come to rest elsewhere, and means over contacts would jump. The ``boundary`` is that
        of :meth:`at_pressure`.
        """
        start = lattice_state
        if self._assembly.has_offsets and last_state is not None:
            start = last_state
        return self._find_rest(load, "exact", boundary, start)

    def _explain_unreached_mean(
        self, goal: MeanGoal, pressure: float, mean: float, has_gravity: bool
    ) -> InputError:
        """Return the error for a ``goal`` that contacts do not reach; at the last ``pressure``
        that was tried their mean was ``mean``. ``has_gravity`` says whether gravity presses them
        too.
        """
        problem = f"contacts of crystal {self.name!r} do not have a {goal} at any pressure"
        pressure_in_words = f"{pressure:.4g} {_PRESSURE_UNITS[self.periods + len(self.faces)]}"
        mean_at_last = f"At a pressure of {pressure_in_words} it is {mean:.4g} {goal.unit}"
        if not has_gravity:
            return InputError(problem, mean_at_last)
        return InputError(problem, f"{mean_at_last}, as gravity presses more", "Give a larger one")

    def _estimate_pressure(self, goal: MeanGoal) -> float:
        """Return the first guess of a search for the pressure, N, N/m or Pa, at which contacts have
        the mean ``goal``.

        The pressure is that of the virial, if all contacts had the same force, without gravity.
        """
        assembly = self._assembly
        force = goal.value
        if goal.kind == "overlap":
            laws = self._laws
            force = float(np.mean(laws.force(np.full(laws.count, goal.value))))
        measure = assembly.measure * math.prod(face.thickness for face in self.faces)
        dimension = self.periods + len(self.faces)
        return force * float(np.sum(assembly.distance)) / (dimension * measure)

    def _solve_each(
        self,
        values: Array,
        loads: Iterable[AppliedLoad],
        finite_overlap: bool | None,
        rank: int = 0,
        boundary: Boundary = "stress",
    ) -> CrystalState:
        """Return the states at rest under ``loads``, which belong to ``values`` in C order.

        Of the axes of ``values`` the last ``rank`` belong to one load: 0 of numbers, 2 of tensors.
        The other axes are the shape of the state. ``finite_overlap``, ``boundary`` and the errors
        are those of :meth:`at_pressure`.
        """
        is_exact = read_finite_overlap(finite_overlap)
        require("boundary", partial(choice, options=BOUNDARIES), boundary)
        geometry: Geometry = "exact" if is_exact else "lattice"
        with _in_double_precision(values):
            solutions = [(self._find_rest(load, geometry, boundary), load) for load in loads]
            return self._stack(values, solutions, rank, is_exact)

    def _stack(
        self,
        values: Array,
        solutions: Sequence[tuple[Rest, AppliedLoad]],
        rank: int,
        is_exact: bool,
    ) -> CrystalState:
        """Return one state of the crystal that holds all ``solutions``: the state at rest, in the
        exact geometry if ``is_exact``, and the load of each of ``values``, in C order. The last
        ``rank`` axes of ``values`` belong to one load.

        Raises InputError if balls overlap by their diameter or more.
        """
        load_shape = values.shape[: values.ndim - rank]
        laws = self._laws
        states = [state for state, _ in solutions]
        displacements, wall_motions = self._find_displacements(states)
        strain = np.array([state.strain for state in states])
        of_contacts = slice(self.n_contacts)  # springs to the ground come last
        overlap = np.array([state.overlap[of_contacts] for state in states])
        self._require_shallow(overlap, [load for _, load in solutions])
        arrays: dict[str, Array] = {
            "normal_force": np.array([laws.force(overlaps) for overlaps in overlap]),
            "overlap": overlap,
            "normal_stiffness": np.array([laws.stiffness(overlaps) for overlaps in overlap]),
            "normal": np.array([state.normal[of_contacts] for state in states]),
            "displacements": displacements,
            "stress": self._find_stresses(states, strain if is_exact else np.zeros_like(strain)),
            "strain": strain,
            "ways": wall_motions,
        }
        attributes: dict[str, Any] = {
            name: read_only(array.reshape(*load_shape, *array.shape[1:]))
            for name, array in arrays.items()
        }
        return CrystalState(self, **attributes, finite_overlap=is_exact)

    def _require_shallow(self, overlap: Array, loads: Sequence[AppliedLoad]) -> None:
        """Raise :class:`InputError` if balls overlap by their diameter or more; ``overlap`` (loads,
        n_c), m, is that of the contacts under each of the ``loads``.
        """
        depth = np.max(overlap / self._distance, axis=1)
        deepest_load = loads[int(np.argmax(depth))]
        modulus = min(ball.material.young_modulus for ball in self.kinds)
        require_shallow(modulus, float(np.max(depth)), lambda: deepest_load.words)

    def _find_displacements(self, states: Sequence[Rest]) -> tuple[Array, Array]:
        """Return the displacements of the balls, (loads, n, d), and of the walls that a load moves,
        (loads, n_w), m, in the ``states`` at rest, one for each load.

        Along an axis on which no floor, wall, clamp or spring to the ground fixes the crystal, the
        mean displacement of the balls is made zero.
        """
        bodies = self._bodies
        d = self.dimension
        displacements = np.zeros((len(states), self.n_balls, d))
        displacements[:, bodies.ball_number >= 0] = [state.displacement for state in states]
        wall_motions = np.array([state.wall_motion for state in states])
        for side in self._sides:
            if side.wall >= 0:
                is_carried = bodies.wall_of_ball == side.wall
                displacements[:, is_carried, side.axis] = wall_motions[:, side.wall, None]
        # a motion of the whole crystal means nothing where no wall is in its way
        if not any("clamped" in face.edges for face in self.faces):
            _, anchored_axes, _ = self._springs
            held_axes = [*(side.axis for side in self._flat_sides), *anchored_axes.tolist()]
            free_axes = np.setdiff1d(np.arange(d), held_axes)
            along_free_axes = displacements[..., free_axes]
            displacements[..., free_axes] -= np.mean(along_free_axes, axis=1, keepdims=True)
        return displacements, wall_motions

    def _find_stresses(self, states: Sequence[Rest], strains: Array) -> Array:
        """Return the stress (loads, p, p) of states at rest on cells with ``strains`` (loads, p,
        p). The unit is N, N/m or Pa with one, two or three periods; tension is above zero.
        """
        p = self.periods
        stresses = np.zeros((len(states), p, p))
        if p:
            for index, state in enumerate(states):
                deformation = np.eye(p) + strains[index]
                stresses[index] = self._assembly.find_stress(
                    state.overlap, state.normal, deformation
                )
        return stresses


@result_class
class CrystalState(Result):
    """The contacts of a crystal under load, as its methods ``at_...`` return it.

    Attributes
    ----------
    crystal : the :class:`~granphon.Crystal`.
    normal_force : (..., n_c) forces of the contacts, N, those with floors and walls last; 0 where a
        contact is open, below 0 where it pulls. "..." is the shape of the load.
    overlap : (..., n_c) m; zero or below of an open contact.
    normal_stiffness : (..., n_c) N/m; 0 where a contact is open.
    normal : (..., n_c, d) unit vectors from ball i to ball j, or into the floor or wall.
    displacements : (..., n, d) of the balls from the positions at which they touch, beside the
        strain of the cell, m.
    stress : (..., p, p) Pa, N/m or N along three, two or one periods; tension is positive. With
        finite overlap the stress is Cauchy's.
    strain : (..., p, p) of the periods, from the cell in which balls only touch; extension is
        positive.
    ways : (..., n_w) displacement of the upper face of each cut neither of whose faces is free, m;
        below zero where the faces come nearer to each other.
    finite_overlap : whether contacts have turned and the cell has deformed. If not, the network has
        the positions at which balls touch, which drops terms of relative order delta/d.
    """

    crystal: Crystal = held(Crystal)
    normal_force: Array = held(float, "... c", "N", "finite")
    overlap: Array = held(float, "... c", "m", "finite")
    normal_stiffness: Array = held(float, "... c", "N/m", "zero or above")
    normal: Array = held(float, "... c d", within="finite")
    displacements: Array = held(float, "... n d", "m", "finite")
    stress: Array = held(float, "... p p", within="finite")
    strain: Array = held(float, "... p p", within="finite")
    ways: Array = held(float, "... w", "m", "finite")
    finite_overlap: bool = held(bool, default=False)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for what the base class refuses, and for
        arrays that were read and do not have the contacts, balls, axes and walls of the crystal.
        """
        super()._check()
        crystal = self.crystal
        d = crystal.dimension
        # the shapes at one load; the other arrays agree with these, as the base class has checked
        expected_shapes = {
            "normal": (crystal.n_contacts, d),
            "displacements": (crystal.n_balls, d),
            "strain": (crystal.periods, crystal.periods),
            "ways": (len(crystal._bodies.walls),),
        }
        load_axes = len(self.shape)
        for name, expected_shape in expected_shapes.items():
            shape = getattr(self, name).shape[load_axes:]
            if shape != expected_shape:
                raise InputError(
                    f"{name} of the CrystalState has the shape {shape} at a load",
                    f"That of its crystal is {expected_shape}",
                    "Make the state again",
                )

    def _field_units(self) -> dict[str, str]:
        """The SI unit of each attribute; that of the stress depends on the number of periods."""
        return {**self.units, "stress": ("", "N", "N/m", "Pa")[self.crystal.periods]}

    def __getitem__(self, index: Any) -> CrystalState:
        """Return the state at some of the loads, indexed like an array; the errors are those of
        :func:`~granphon.media.state.select_loads`.
        """
        load_count = math.prod(self.shape)
        load_axes = len(self.shape)
        # the numbers of the loads are indexed, so that an index cannot reach the axes behind them
        selected_loads = select_loads(self.shape, index)
        selected_arrays: dict[str, Any] = {}
        for name in _PER_LOAD:
            array = getattr(self, name)
            array_of_loads = array.reshape(load_count, *array.shape[load_axes:])
            selected_arrays[name] = read_only(array_of_loads[selected_loads])
        return replace(self, **selected_arrays)

    def __repr__(self) -> str:
        forces = self.normal_force
        forces_text = f"{np.min(forces):.6g} to {np.max(forces):.6g} N"
        return f"CrystalState({self.crystal!r}, normal_force={forces_text}, shape={self.shape})"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the load; () for a single one."""
        return self.normal_force.shape[:-1]

    @property
    def is_single(self) -> bool:
        """Whether this is the state at one load."""
        return self.shape == ()

    @property
    def shear_stiffness(self) -> Array:
        """(..., n_c) kappa = 8 G* a of the :attr:`contact_radius` a, N/m; zero without friction.
        G* is that of :class:`~granphon.balls.ball.ContactConstants`.
        """
        crystal = self.crystal
        return self._punch * (crystal._constants["mindlin_ratio"] if crystal.friction else 0.0)

    @cached_property
    def _punch(self) -> Array:
        """(..., n_c) stiffness 2 E* a of a flat punch as wide as the contact, N/m."""
        laws = self.crystal._laws
        if not laws.has_radii:
            return self.normal_stiffness
        stiffnesses = np.empty(self.normal_stiffness.shape)
        for index in np.ndindex(self.shape):
            stiffnesses[index] = laws.punch(self.overlap[index])
        return read_only(stiffnesses)

    @property
    def torsion_stiffness(self) -> Array:
        """(..., n_c) stiffness against twist, N m."""
        twist_modulus = self.crystal._constants["twist_modulus"]
        distance = self.crystal._distance
        return self.crystal.contact_model.find_torsion(
            self.normal_stiffness, distance, self.contact_radius, twist_modulus
        )

    @property
    def bending_stiffness(self) -> Array:
        """(..., n_c) stiffness against rolling, N m."""
        return self.crystal.contact_model.find_bending(
            self.normal_stiffness, self.crystal._distance
        )

    @property
    def contact_radius(self) -> Array:
        """(..., n_c) radius of the contact, m: that of the law, or k/2E* if the law does not know
        the radius.
        """
        return np.asarray(self._punch / (2.0 * self.crystal._constants["modulus"]))

    @property
    def exponent(self) -> Any:
        """(...) exponent d log v / d log P of all sound velocities v, if all components of the load
        grow by one factor; terms of relative order delta/d are left out.

        The exponent of a contact is f k'/2k^2, with the slope k' of the stiffness of its law:
        (a - 1)/2a where f goes as delta^a. All velocities have it where the shear stiffness is in
        proportion to the normal stiffness, as by Hertz's law, powers, tables and DMT, and where
        contacts do not resist slip. By JKR's law with friction each velocity has an exponent of its
        own, as the shear stiffness follows the radius of the contact.

        Raises :class:`~granphon.base.errors.InputError` if contacts do not have one exponent in
        common, if shear and normal stiffness do not, and if no contact is closed.
        """
        exponents = np.empty(self.shape)
        for index in np.ndindex(self.shape):
            force = self.normal_force[index]
            k = self.normal_stiffness[index]
            is_closed = k > 0.0
            if not np.any(is_closed):
                raise InputError(
                    f"no contact of crystal {self.crystal.name!r} is closed",
                    "Without contacts there is no sound whose velocity could grow",
                    "Press the crystal",
                )
            slope = self.crystal._laws.stiffness_slope(self.overlap[index])
            closed_k = k[is_closed]
            contact_exponents = 0.5 * (force[is_closed] / closed_k) * (slope[is_closed] / closed_k)
            if np.ptp(contact_exponents) > _EXPONENT_ROUNDING:
                raise InputError(
                    f"the exponents of contacts differ, from {np.min(contact_exponents):.6g} to"
                    f" {np.max(contact_exponents):.6g}",
                    "Their laws are not one power",
                    "Compare the velocities at two loads",
                )
            exponents[index] = np.mean(contact_exponents)
            self._require_common_growth(index, float(exponents[index]))
        return exponents[()]

    def _require_common_growth(self, index: tuple[int, ...], exponent: float) -> None:
        """Raise InputError if contacts resist slip and the exponent of their shear stiffness at the
        load ``index``, f kappa'/(2 k kappa), is not the ``exponent`` of their normal stiffness.

        The slope kappa' of the stiffness is a central difference over the overlap.
        """
        crystal = self.crystal
        laws = crystal._laws
        has_slip = crystal.friction and crystal.ball_motions.count > 1  # on a line nothing slips
        force = self.normal_force[index]
        shear_stiffness = self.shear_stiffness[index]
        is_growing = (shear_stiffness > 0.0) & (force != 0.0)
        if not (has_slip and laws.has_radii and np.any(is_growing)):
            return
        overlap = self.overlap[index]
        k = self.normal_stiffness[index]
        slope = laws.stiffness_slope(overlap)
        steps = np.zeros(overlap.shape)
        growing_k = k[is_growing]
        rates = np.abs(slope[is_growing] / growing_k) + np.abs(growing_k / force[is_growing])
        steps[is_growing] = _SLOPE_STEP / rates
        above = laws.punch(overlap + steps)[is_growing]
        below = laws.punch(overlap - steps)[is_growing]
        growth = (above - below) / (2.0 * steps[is_growing] * laws.punch(overlap)[is_growing])
        shear_exponents = 0.5 * force[is_growing] / growing_k * growth
        differences = np.abs(shear_exponents - exponent)
        if np.max(differences) > _MOST_EXPONENT_DIFFERENCE:
            shear_exponent = shear_exponents[np.argmax(differences)]
            raise InputError(
                f"the exponents of contacts differ: {exponent:.6g} of the normal stiffness, and"
                f" {shear_exponent:.6g} of the shear stiffness",
                "The shear stiffness follows the radius of the contact, and the velocities have no"
                " exponent in common",
                "Compare the velocities at two loads",
            )

    @property
    def scales(self) -> Units:
        """Reduced units at one load, those of the :attr:`network`.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """
        return self.network.scales

    @cached_property
    def limits(self) -> tuple[Check, ...]:
        """The conditions within which the state holds.

        Up to three conditions limit the largest value that a ratio has over the contacts. The
        ratios are the contact radius over the smaller radius of its balls, at touch; the overlap
        over the last overlap of the law, if a law has one; and the mean pressure of the contact
        over the smaller yield strength of its bodies, if one is known. Further conditions stand for
        each diameter and material constant that no solid ball has.
        """
        crystal = self.crystal
        arms = np.minimum(crystal.contacts.arm_i, crystal.contacts.arm_j)
        on_flat_sides = [crystal._mean_radii[side.balls] for side in crystal._flat_sides]
        ball_radius = np.concatenate([arms, *on_flat_sides])
        relative_radius = np.max(self.contact_radius / ball_radius, axis=-1)
        checks = [check_limit("contact_radius", relative_radius)]
        last_overlap = crystal._laws.most
        if np.any(np.isfinite(last_overlap)):
            ratio = np.max(np.maximum(self.overlap, 0.0) / last_overlap, axis=-1)
            checks.append(check_limit("table", ratio))
        checks += self._check_balls()
        strengths = crystal._contact_strengths
        if np.any(np.isfinite(strengths)):
            area = math.pi * self.contact_radius**2
            pressure = np.divide(self.normal_force, area, out=np.zeros_like(area), where=area > 0.0)
            checks.append(check_limit("yield", np.max(pressure / strengths, axis=-1)))
        return tuple(checks)

    def _check_balls(self) -> list[Check]:
        """Return a condition for each diameter or material constant of a kind of ball that is
        beyond what solid balls have; none if all are within.
        """
        crystal = self.crystal
        checks = []
        for name, (attribute, _, _, limit, at_least) in BALL_LIMITS.items():
            find_constant = attrgetter(attribute)
            for ball, kind_name in zip(crystal.kinds, crystal.names, strict=True):
                constant = find_constant(ball)
                is_beyond = constant < limit if at_least else constant > limit
                if is_beyond:
                    at_each_load = np.full(self.shape, constant)
                    checks.append(check_limit(name, at_each_load, f" (ball {kind_name})"))
        return checks

    @property
    def valid(self) -> Any:
        """Whether the state is inside the range of its contact laws, at each load; :attr:`warnings`
        say why not.

        The contact radius must be no more than a tenth of the radius of a ball, the mean pressure
        of a contact no more than 1.07 of the yield strength, if that is given, and the overlap
        within the table of a tabulated law. A diameter, density or Young modulus that no solid ball
        has, so that its unit is probably wrong, is not valid either.
        """
        are_met = np.all([check.ok for check in self.limits], axis=0)
        return bool(are_met) if self.is_single else are_met

    @property
    def warnings(self) -> tuple[str, ...]:
        """The reasons to doubt the state, a warning each; empty if there are none."""
        warnings = [check.warning for check in self.limits]
        return tuple(warning for warning in warnings if warning is not None)

    @cached_property
    def _is_clamped(self) -> Flags:
        """(n,) whether each ball belongs to a clamped layer."""
        is_clamped = np.zeros(self.crystal.n_balls, bool)
        for side in self.crystal._sides:
            if side.edge == "clamped":
                is_clamped[side.balls] = True
        return is_clamped

    @cached_property
    def _in_network(self) -> Flags:
        """(n_c,) whether the network has each contact: whether the contact is closed, and at most
        one of its two bodies is held.
        """
        is_clamped = self._is_clamped
        table = self.crystal.contacts
        between_balls = is_clamped[table.i] & is_clamped[table.j]
        on_flat_sides = [is_clamped[side.balls] for side in self.crystal._flat_sides]
        is_between_held = np.concatenate([between_balls, *on_flat_sides])
        return np.asarray((self.normal_stiffness > 0.0) & ~is_between_held)

    @cached_property
    def network(self) -> ContactNetwork:
        """The cell as a :class:`~granphon.ContactNetwork`, without contacts that are open, and
        without those of two bodies that are held.

        Floors and walls are bodies of infinite mass and radius, after the balls, and balls of a
        clamped layer have an infinite mass: these bodies are held. The ``kinds`` of the network are
        the names of the kinds and the walls of the crystal, and "floor". With
        :attr:`finite_overlap`, cell and positions are those at rest under the load, and static
        forces act on displacements (prestress); otherwise they are those at which balls only touch.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """
        if not self.is_single:
            raise InputError(
                f"the state holds {int(np.prod(self.shape))} loads",
                "A network, atoms and phonons belong to one",
                "Make a state with one load, as crystal.at_pressure(1e5) does, or take one of"
                " these: state[0]",
            )
        crystal = self.crystal
        p = crystal.periods
        d = crystal.dimension
        return ContactNetwork(
            pbc=(p > 0, p > 1, p > 2),
            motions=crystal.named_motions.name,
            dimension=d,
            prestress=self.finite_overlap,
            adhesive=crystal._laws.can_adhere,
            contact_model=crystal.contact_model,
            on_site=self._list_springs(),
            **self._list_bodies(),
            **self._list_contacts(),
        )

    def _list_springs(self) -> Array | None:
        """Return the springs to the ground of the network's bodies, those of :meth:`_list_bodies`:
        an array (bodies, motions), N/m and N m, with zeros of floors and walls. None without
        springs.
        """
        on_site = self.crystal.on_site
        if on_site is None:
            return None
        return np.pad(on_site, ((0, len(self.crystal._flat_sides)), (0, 0)))

    def _list_bodies(self) -> dict[str, Any]:
        """Return the cell and the bodies, first the n balls and then a body for each face on a
        floor or wall, as arguments of a network, by name: lengths in m, masses in kg, moments of
        inertia in kg m^2.
        """
        crystal = self.crystal
        flat_sides = crystal._flat_sides
        cell, positions = self._place_bodies()
        # a body of infinite mass and radius does not move, and is flat
        infinities = np.full(len(flat_sides), np.inf)
        masses = np.where(self._is_clamped, np.inf, crystal.masses)
        inertias = np.array([ball.inertia for ball in crystal.kinds])[crystal.kind]
        kinds = [crystal.names[number] for number in crystal.kind.tolist()]
        kinds += [side.body.name for side in flat_sides if side.body]
        return {
            "cell": cell,
            "positions": positions,
            "radii": np.append(crystal.radii, infinities),
            "masses": np.append(masses, infinities),
            "inertias": np.append(inertias, infinities),
            "kinds": tuple(kinds),
        }

    def _place_bodies(self) -> tuple[Array, Array]:
        """Return the cell (3, 3), m, with zeros for axes without a period, and the positions of the
        bodies of :meth:`_list_bodies`, (bodies, 3), m: with finite overlap those at rest under the
        load, otherwise those at which balls only touch.
        """
        crystal = self.crystal
        flat_sides = crystal._flat_sides
        n = crystal.n_balls
        d = crystal.dimension
        p = crystal.periods
        deformation = np.eye(d)
        displacements = np.zeros((n, d))
        if self.finite_overlap:
            deformation[:p, :p] += self.strain
            displacements = self.displacements
        cell = np.zeros((3, 3))
        cell[:p, :d] = crystal.cell @ deformation.T
        positions = np.zeros((n + len(flat_sides), 3))
        positions[:n, :d] = crystal.positions @ deformation.T + displacements
        # a floor or wall stands where the balls at its face touch it, on average
        for number, side in enumerate(flat_sides, start=n):
            radii = crystal._mean_radii[side.balls]
            heights = positions[side.balls, side.axis] + side.sign * radii
            positions[number, side.axis] = np.mean(heights)
        return cell, positions

    def _list_contacts(self) -> dict[str, Any]:
        """Return the contacts :attr:`_in_network` as arguments of a network, by name, those with
        floors and walls last.
        """
        crystal = self.crystal
        table = crystal.contacts
        i, j, arm_i, arm_j = self._list_ends()
        shift = np.zeros((crystal.n_contacts, 3), np.intp)
        shift[: len(table), : crystal.periods] = table.shift
        normal = np.zeros((crystal.n_contacts, 3))
        normal[:, : crystal.dimension] = self.normal
        if self.finite_overlap:  # arms are the balls' own radii less half of the overlap
            bulges = np.append(crystal._bulges, np.zeros(len(crystal._flat_sides)))
            half_overlap = 0.5 * self.overlap
            arm_i = arm_i + bulges[i] - half_overlap
            arm_j = arm_j + bulges[j] - half_overlap
        columns: dict[str, Any] = {
            "i": i,
            "j": j,
            "shift": shift,
            "normal": normal,
            "normal_force": self.normal_force,
            "normal_stiffness": self.normal_stiffness,
            "shear_stiffness": self.shear_stiffness,
            "torsion_stiffness": self.torsion_stiffness,
            "bending_stiffness": self.bending_stiffness,
            "arm_i": arm_i,
            "arm_j": arm_j,
        }
        in_network = self._in_network
        contacts = {name: column[in_network] for name, column in columns.items()}
        if self.finite_overlap:  # the statics are those of normal forces alone
            contacts["tangential_force"] = np.zeros((np.count_nonzero(in_network), 3))
        return contacts

    def _list_ends(self) -> tuple[Index, Index, Array, Array]:
        """Return the bodies i (n_c,) and j (n_c,) of the contacts, and the arms (n_c,) of i and
        (n_c,) of j at touch, m. Of a contact with a floor or wall, j is the number of that body in
        :meth:`_list_bodies`, and the arm of j is zero.
        """
        crystal = self.crystal
        table = crystal.contacts
        i = [table.i]
        j = [table.j]
        arm_i = [table.arm_i]
        arm_j = [table.arm_j]
        for number, side in enumerate(crystal._flat_sides, start=crystal.n_balls):
            i.append(side.balls)
            j.append(np.full(len(side.balls), number))
            arm_i.append(crystal._mean_radii[side.balls])
            arm_j.append(np.zeros(len(side.balls)))
        return np.concatenate(i), np.concatenate(j), np.concatenate(arm_i), np.concatenate(arm_j)


def find_mindlin_ratio(crystal: Crystal) -> float | None:
    """Return the ratio of the shear to the normal stiffness that all contacts have in common, zero
    without friction; None if they do not have one.

    A contact whose law has a contact radius of its own, as that of JKR, has no such ratio: its
    shear stiffness follows from that radius, and the ratio depends on the load.
    """
    if not crystal.friction:
        return 0.0
    ratios = crystal.mindlin_ratios
    if np.any(ratios) and crystal._laws.has_radii:
        return None
    return float(ratios[0]) if np.ptp(ratios) <= _RATIO_ROUNDING else None


def _name_support(edge: str | Wall) -> str:
    """Return in words what balls stand on at an ``edge`` of a cut: "clamp", "floor" or the name of
    a wall.
    """
    if isinstance(edge, Wall):
        return edge.name
    return "clamp" if edge == "clamped" else edge


def _require_room(n_cells: int, crystal: Crystal) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if ``n_cells`` cells of a ``crystal`` do not
    fit into memory, or have more than :data:`_MOST_BALLS` balls.
    """
    n_balls = n_cells * crystal.n_balls
    memory = _BALL_BYTES * n_cells * (crystal.n_balls + crystal.n_contacts)
    require_memory(f"crystals of {n_balls:,} balls", memory, "Take fewer cells")
    if n_balls > _MOST_BALLS:
        problem = f"the crystal would have {n_balls:,} balls"
        raise InputError(problem, mend=f"Make it of up to {_MOST_BALLS:,}")


@contextmanager
def _in_double_precision(values: Array) -> Iterator[None]:
    """Within the block of ``with``, let NumPy raise a FloatingPointError for an overflow, an
    invalid operation or a division by zero, and turn every FloatingPointError into an InputError
    about the load ``values``.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except FloatingPointError:
        problem = f"a crystal under a load of {brief(values.tolist())} is beyond double precision"
        raise InputError(problem, mend="Lower the load, or compare the units") from None
