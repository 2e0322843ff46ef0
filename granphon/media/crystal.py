"""Crystals: balls of several kinds on any sites, and their contacts under any load.

A crystal is data: kinds of balls, a cell, places at which neighbours touch, the law of each
contact, and how its edges are held. Its methods ``at_...`` find the state at rest
(:mod:`granphon.media.crystal_statics`), whose network of contacts is what velocities, bands and
waves are found from.

Where a crystal has been cut, its remaining periods lie along x, or in the xy plane, and its layers
follow each other along the next axis: y in a plane, z in space, x of a chain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from operator import attrgetter
from string import ascii_uppercase
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.sparse_matrices import compose
from granphon.balls.ball import BALL_LIMITS, RIGID_PLANE, Ball, Body, ContactConstants
from granphon.balls.contact_laws import (
    DMT,
    JKR,
    Hertz,
    PairLaw,
    PowerLaw,
    TabulatedLaw,
    check_law,
    law_of_pair,
    read_laws,
)
from granphon.balls.contact_model import ContactModel, PlainLaw
from granphon.balls.contact_table import (
    TOUCH,
    ContactTable,
    find_contacts,
    repeat_contacts,
    require_joined,
)
from granphon.balls.lattices import LATTICES, Lattice, find_structure
from granphon.balls.layers import Layers, find_faces, read_edges
from granphon.balls.motions import Motions, allowed_motions, select_motions
from granphon.balls.packing import read_rolling, require_shallow
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, brief
from granphon.base.memory import require_memory
from granphon.base.results import Result, read_only
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    finite_array,
    index_array,
    label,
    lengths,
    real_array,
    require,
    truth,
    whole_number,
)
from granphon.dynamics.elasticity import voigt_pairs
from granphon.media.crystal_statics import Frame, Push, Rest, Springs, settle, settle_exactly
from granphon.media.limits import Check, check_limit
from granphon.media.state import read_finite_overlap
from granphon.networks.network import ContactNetwork

#: most cells of a supercell along a period, and most layers of a cut
_MOST_CELLS = 1_000_000
#: most balls of a crystal: its contacts are held in memory, about 1 kB a ball
_MOST_BALLS = 10_000_000
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
#: relative error at which a mean force or overlap is reached, and most states on the way to it
_MEAN = 4e-15
_MEANS = 60
#: the first of these of a sample, which is at rest to 1e-12 of the mean force
_SAMPLED = 1e-11
#: difference of the exponents of contacts that is put down to rounding
_SAME_EXPONENT = 1e-9


@dataclass(frozen=True, eq=False)
class Faces:
    """The two faces of a cut, across ``axis`` of the crystal, lower and upper.

    ``balls`` are those that a face touches, or the layer that it holds; ``thickness`` is that of
    all layers, m.
    """

    axis: int
    thickness: float
    edges: tuple[str, str]
    balls: tuple[Index, Index]

    @property
    def is_pressed(self) -> bool:
        """Whether both faces are walls, of which a load moves the upper one."""
        return "free" not in self.edges


class Side(NamedTuple):
    """One face of a cut: its axis, which side it is on (-1 lower, 1 upper), how it is held, and the
    balls there.

    ``wall`` is the number of the wall that a load moves; -1 if it moves none.
    """

    axis: int
    sign: float
    edge: str
    balls: Index
    wall: int


@dataclass(frozen=True, eq=False, repr=False, init=False)
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
        :class:`~granphon.balls.contact_laws.PairLaw` serves for all pairs; it is compared with its
        derivatives once. A law whose force is zero at overlaps below 0 only pushes. One that pulls
        there is a bond, which never opens; or it adheres down to its ``least_overlap``, and is zero
        below that.
    friction : whether contacts resist shear, with the stiffness of Mindlin for contacts that do not
        slip: kappa = 8 G* a, where the contact radius a of any law follows from its stiffness k = 2
        E* a.
    motions : the motions of each ball, as for :class:`~granphon.Packing`.
    torsion, bending : the stiffness of a contact against twist and rolling, over k times the square
        of the distance of its two centres; or torsion="mindlin", which is (16/3) a^3 over the sum
        of 1/G of both balls.
    name : what messages call the crystal.

    Attributes
    ----------
    kinds, names : the different balls, and what each kind is called: A, B, C, ... if its ball has
        no name.
    kind : (n,) the number of the kind of each ball.
    deviations : (n,) diameters of the balls of a :meth:`sample`, minus the diameters of their
        kinds, m; None of balls that are not drawn.
    contacts : the :class:`~granphon.balls.contact_table.ContactTable`, in m.

    Raises
    ------
    InputError : arrays whose shapes do not fit, numbers that are not finite, balls that overlap,
        that miss each other by less than a thousandth, or that touch nothing; contacts that do not
        join all balls; a law that lacks a pair or a method.
    """

    kinds: tuple[Ball, ...]
    names: tuple[str, ...]
    kind: Annotated[Index, "n"]
    cell: Annotated[Array, "p d", "", "finite"]
    positions: Annotated[Array, "n d", "", "finite"]
    contacts: ContactTable
    law: (
        Hertz
        | PowerLaw
        | DMT
        | JKR
        | TabulatedLaw
        | tuple[tuple[tuple[str, str], PlainLaw], ...]
        | Any
    )
    friction: bool
    motions: str | None
    torsion: float | str
    bending: float
    name: str
    faces: tuple[Faces, ...]
    deviations: Annotated[Array | None, "n?", "", "finite"]

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
        name: str = "of these balls",
    ) -> None:
        require("name", label, name)
        centres = real_array("positions", positions)
        vectors = real_array("cell", cell)
        if centres.ndim != 2 or not len(centres) or not 1 <= centres.shape[1] <= 3:
            problem = f"positions of the crystal have the shape {centres.shape}"
            raise InputError(problem, mend="Give (n, d) centres in m, d = 1, 2 or 3")
        n, d = centres.shape
        vectors = vectors.reshape(0, d) if vectors.size == 0 else vectors
        if vectors.ndim != 2 or vectors.shape[1] != d or len(vectors) > d:
            problem = f"the cell has the shape {vectors.shape}, and positions have {d} coordinates"
            raise InputError(problem, mend=f"Give up to {d} vectors of {d} numbers, as rows, in m")
        if not (np.all(np.isfinite(centres)) and np.all(np.isfinite(vectors))):
            raise InputError(
                "the cell or a position of the crystal is not finite",
                mend="Give finite numbers, in m",
            )
        site_balls = list_balls(balls)
        if len(site_balls) != n:
            raise InputError(
                f"there are {len(site_balls)} balls and {n} positions",
                mend="Give one ball for each site",
            )
        kinds, kind = find_kinds(site_balls)
        p = len(vectors)
        radii = np.array([ball.radius for ball in kinds])[kind]
        mean = float(np.mean(radii))
        if np.any(np.abs(vectors[:, p:]) > TOUCH * mean):
            room = ("", "along x", "in the xy plane", "")[p]
            raise InputError(
                f"the cell of crystal {name!r} does not lie {room}", mend="Turn the crystal"
            )
        if p and not abs(np.linalg.det(vectors[:, :p] / mean)) > 1e-3:
            problem = f"the cell of crystal {name!r} has no room for a ball"
            why = f"Its vectors are too short for balls of {2.0 * mean:.4g} m, or not independent"
            raise InputError(problem, why, "Give lengths in m")
        if p == 0 and n == 1:
            raise InputError("a single ball without a period touches nothing", mend="Give a cell")
        contacts = find_contacts(vectors, centres, name, radii)
        rolling = read_rolling(f"the crystal {name!r}", d, motions, torsion, bending)
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
            torsion=rolling[0],
            bending=rolling[1],
            name=name,
            faces=(),
            deviations=None,
        )

    def _set(self, **values: Any) -> None:
        for key, value in values.items():
            kept = read_only(value) if isinstance(value, np.ndarray) else value
            object.__setattr__(self, key, kept)
        _ = self._springs  # the laws of all pairs are there

    @classmethod
    def _of_fields(cls, *values: Any) -> Self:
        crystal = object.__new__(cls)
        crystal._set(
            **{field.name: value for field, value in zip(fields(cls), values, strict=True)}
        )
        return crystal

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for what the constructor refuses or could
        not have found.
        """
        super()._check()
        read_rolling(
            f"the crystal {self.name!r}", self.dimension, self.motions, self.torsion, self.bending
        )
        table = self.contacts
        n = self.n_balls
        radii = self._mean_radii
        ends, allowed = (
            np.concatenate(
                [table.i, table.j, *(balls for face in self.faces for balls in face.balls)]
            ),
            range(n),
        )
        separations = self.positions[table.j] + table.shift @ self.cell - self.positions[table.i]
        tolerance = TOUCH * float(np.mean(radii))
        for holds, problem in (
            (np.all(np.isin(self.kind, range(len(self.kinds)))), "a ball has no kind"),
            (len(self.names) == len(self.kinds), "there are not as many names as kinds"),
            (np.all(np.isin(ends, allowed)), "a contact or a face names a ball that is not there"),
            (
                np.all(np.abs(table.vector - separations) <= tolerance),
                "a contact does not lead from ball to ball",
            ),
            (
                np.all(
                    np.abs(
                        table.normal * np.linalg.norm(separations, axis=1)[:, None] - separations
                    )
                    <= tolerance
                ),
                "a normal is not along it",
            ),
            (np.all(np.abs(table.arm_i - radii[table.i]) <= tolerance), "an arm is not the radius"),
            (np.all(np.abs(table.arm_j - radii[table.j]) <= tolerance), "an arm is not the radius"),
            (
                all(face.thickness > 0.0 and np.isfinite(face.thickness) for face in self.faces),
                "a cut has no thickness",
            ),
        ):
            if not holds:
                raise InputError(
                    f"{problem} in the data of the crystal {self.name!r}",
                    mend="Make the crystal again",
                )

    def _derive(self, **changes: Any) -> Self:
        """Return the crystal with other values of some attributes."""
        return self._of_fields(
            *(changes.get(field.name, getattr(self, field.name)) for field in fields(self))
        )

    def _take(
        self, origin: Index, contacts: ContactTable, positions: Array, **changes: Any
    ) -> Self:
        """Return a crystal of balls that are those of the numbers ``origin``; they keep what they
        are, and their faces.
        """
        kind = self.kind[origin]
        used = kind[np.sort(np.unique(kind, return_index=True)[1])]
        faces = []
        for face in self.faces:
            low, high = (read_only(np.flatnonzero(np.isin(origin, balls))) for balls in face.balls)
            faces.append(replace(face, balls=(low, high)))
        return self._derive(
            kinds=tuple(self.kinds[number] for number in used),
            names=tuple(self.names[number] for number in used),
            kind=np.argsort(used)[np.searchsorted(np.sort(used), kind)],
            positions=positions,
            contacts=contacts,
            deviations=None if self.deviations is None else self.deviations[origin],
            faces=tuple(faces),
            **changes,
        )

    # -- other ways to make one --------------------------------------------------------------------

    @classmethod
    def on(cls, lattice: str | Lattice, balls: Sequence[Ball], **options: Any) -> Self:
        """Make a crystal of kinds of balls on the sites of a lattice, in turn, so that neighbours
        touch.

        Parameters
        ----------
        lattice : the name of a lattice of :class:`~granphon.Packing`, "NaCl", "CsCl" or
            "zincblende", or a :class:`~granphon.Lattice`. A chain takes any number of kinds, and
            has as many balls in its cell; elsewhere the number of sites in the cell must be a
            multiple of the number of kinds.
        balls : a ball of each kind.
        options : options of the class: law, friction, motions, torsion, bending, name.

        The cell is scaled until neighbours touch. Raises :class:`~granphon.base.errors.InputError`
        if they cannot all touch, because the radii do not fit the lattice.
        """
        kinds = list_balls(balls)
        find_kinds(kinds)
        if (isinstance(lattice, str) and lattice == "chain") or lattice is LATTICES["chain"]:
            steps = [
                first.radius + second.radius
                for first, second in zip(kinds, kinds[1:] + kinds[:1], strict=True)
            ]
            positions = np.concatenate([[0.0], np.cumsum(steps)])
            return cls(
                kinds,
                [[float(positions[-1])]],
                positions[:-1, None],
                **({"name": "chain"} | options),
            )
        structure = find_structure(lattice)
        if len(kinds) > structure.n_balls or structure.n_balls % len(kinds):
            sites = counted(structure.n_balls, "site")
            problem = (
                f"{counted(len(kinds), 'kind')} of balls do not go on the {sites} in a cell of"
                f" {structure.name}"
            )
            mend = (
                "Give a lattice that has a multiple, such as NaCl or CsCl for two kinds, or a"
                " cell and places"
            )
            raise InputError(problem, "Kinds follow each other on the sites of one cell", mend)
        balls_on = [kinds[site % len(kinds)] for site in range(structure.n_balls)]
        radii = np.array([ball.radius for ball in balls_on])
        table = structure.contacts
        separations = radii[table.i] + radii[table.j]
        scale = float(np.mean(separations))
        if np.ptp(separations) > TOUCH * scale:
            low = int(np.argmin(separations))
            high = int(np.argmax(separations))
            pairs = [
                f"those of sites {table.i[contact]} and {table.j[contact]} at {separations[contact]:.6g} m"
                for contact in (low, high)
            ]
            distances = f"Centres would be apart: {pairs[0]}, {pairs[1]}"
            problem = f"balls of these sizes cannot all touch on the {structure.name} lattice"
            raise InputError(
                problem,
                distances,
                "Give balls of one size, or a cell and places at which they touch",
            )
        cell = scale * structure.vectors
        if len(kinds) == structure.n_balls == 2:
            # the larger of two balls must not touch each other before they touch the smaller
            p = structure.periods
            images = np.stack(np.meshgrid(*[[-1, 0, 1]] * p), axis=-1).reshape(-1, p)
            gap = float(np.min(np.linalg.norm(images[np.any(images, axis=1)] @ cell, axis=1)))
            small, large = sorted(kinds, key=lambda ball: ball.diameter)
            if gap < large.diameter * (1.0 - TOUCH):
                least = (
                    2.0 * large.diameter * (0.5 * (small.diameter + large.diameter) / gap)
                    - large.diameter
                )
                name = small.name or "AB"[kinds.index(small)]
                problem = (
                    f"ball {name} of {small.diameter:g} m is too small for its site in"
                    f" {structure.name}"
                )
                ratio = small.diameter / large.diameter
                least_ratio = least / large.diameter
                why = f"The others, of {large.diameter:g} m, touch each other before they touch it:"
                why += f" the ratio of the diameters is {ratio:.4g}, and must be {least_ratio:.4g} or more"
                raise InputError(problem, why, f"Give it a diameter of {least:.6g} m or more")
        return cls(
            balls_on, cell, scale * structure.positions, **({"name": structure.name} | options)
        )

    @classmethod
    def from_atoms(cls, atoms: Any, balls: Mapping[str, Ball], **options: Any) -> Self:
        """Make a crystal from ``atoms``, an ``ase.Atoms`` with lengths in m, with one of ``balls``
        for each chemical symbol.

        ``options`` are those of the class. The crystal repeats along the vectors of the cell that
        are periodic. Where all balls have the same z and none of the periods leaves the plane, it
        is one of the plane; on a line it is a chain. Kinds are called by their symbols.

        Raises :class:`~granphon.base.errors.InputError` for a symbol without a ball, and for what
        the class does not allow.
        """
        if not all(
            hasattr(atoms, name) for name in ("positions", "cell", "pbc", "get_chemical_symbols")
        ):
            raise InputError(
                f"{brief(atoms)} are not Atoms", mend="Give ase.Atoms, with lengths in m"
            )
        symbols = atoms.get_chemical_symbols()
        if not symbols or not isinstance(balls, Mapping):
            problem = f"the balls are {brief(balls)}" if symbols else "there are no atoms"
            raise InputError(
                problem,
                mend='Give balls by symbols, as {"Na": ball}' if symbols else "Give one or more",
            )
        missing = sorted(set(symbols) - set(balls))
        if missing:
            raise InputError(
                f"there is no ball for {', '.join(missing)}", mend="Give one for each symbol"
            )
        find_kinds([balls[symbol] for symbol in symbols])
        named = {symbol: replace(balls[symbol], name=symbol) for symbol in sorted(set(symbols))}
        positions = np.array(atoms.positions, float)
        cell = np.array(atoms.cell, float)[np.array(atoms.pbc, bool)]
        tolerance = TOUCH * float(np.mean([ball.radius for ball in named.values()]))
        d = 3
        while (
            d > 1
            and len(cell) < d
            and np.ptp(positions[:, d - 1]) <= tolerance
            and not np.any(np.abs(cell[:, d - 1]) > tolerance)
        ):
            d -= 1
        return cls(
            [named[one] for one in symbols],
            cell[:, :d],
            positions[:, :d],
            **({"name": "of these atoms"} | options),
        )

    def repeat(self, shape: Any) -> Self:
        """Return the crystal of ``shape`` (L1, ..., Lp) cells of this one as one cell.

        Balls come in the order of cells, ball by ball of each cell, with the last period fastest.
        """
        if not self.periods:
            raise InputError(
                f"crystal {self.name!r} has no period along which it could be repeated",
                mend="Give its cell",
            )
        counts = require("shape", lambda value: lengths(value, 1, _MOST_CELLS, self.periods), shape)
        _require_room(math.prod(counts), self)
        table = self.contacts
        n = self.n_balls
        cells, *ends = repeat_contacts(table.i, table.j, table.shift, n, tuple(counts))
        origin = np.tile(np.arange(n), len(cells))
        rows = np.tile(np.arange(len(table)), len(cells))
        positions = ((cells @ self.cell)[:, None] + self.positions).reshape(-1, self.dimension)
        return self._take(
            origin, table.take(rows, *ends), positions, cell=self.cell * np.array(counts)[:, None]
        )

    def sample(self, shape: Any = None, seed: int = 0, diameters: ArrayLike | None = None) -> Self:
        """Return a supercell whose balls have their own diameters, with the distributions that
        their kinds have as spreads.

        Parameters
        ----------
        shape : (L1, ..., Lp), numbers of cells along the periods; by default one cell.
        seed : the same seed gives the same diameters on any machine, and the same as in
            :class:`~granphon.DirectSimulation`. A larger sample contains the diameters of a smaller
            one, before their mean is shifted.
        diameters : (L1, ..., Lp), m, or (L1, ..., Lp, n) of n > 1 balls in the cell, instead of a
            shape and a seed.

        The diameters of a kind are shifted so that their mean is exactly the diameter of the kind.
        The diameters differ little, as in a packing. All balls of a kind have the mass and the
        contact law of the mean ball, and mean balls touch at the reference sites. A contact of
        balls with the deviations D_i and D_j has the overlap (D_i + D_j)/2 there. In the state at
        rest some contacts are then open, and some balls may be loose. Means of forces and overlaps,
        as
        :meth:`at_force` takes them, are over all contacts of the sample, the open ones too.

        Raises :class:`~granphon.base.errors.InputError` for another shape of the arrays, numbers
        that are not finite and above zero, and crystals without a spread of which no diameters are
        given.
        """
        p = self.periods
        n = self.n_balls
        listed = None
        if diameters is not None:
            listed = finite_array("diameters", diameters, "m", "above zero")
            if listed.ndim != p + (n > 1) or (n > 1 and listed.shape[-1] != n) or shape is not None:
                axes = ", ".join([*(f"L{axis + 1}" for axis in range(p)), *[str(n)] * (n > 1)])
                problem = f"diameters have the shape {listed.shape}, and shape is {brief(shape)}"
                raise InputError(problem, mend=f"Give an array ({axes}), and no shape")
            shape = listed.shape[:p]
        elif not any(ball.spread for ball in self.kinds):
            problem = f"no ball of crystal {self.name!r} has a spread of diameters"
            raise InputError(
                problem,
                mend="Give one to a ball, as granphon.Ball(material, 8e-3, spread=...), or"
                " diameters",
            )
        counts = tuple(np.atleast_1d(np.asarray((1,) * p if shape is None else shape)).tolist())
        supercell = self.repeat(counts) if p or counts else self
        deviations = np.zeros(supercell.n_balls) if listed is None else listed.ravel().astype(float)
        for number, ball in enumerate(self.kinds):
            members = supercell.kind == number
            if listed is None and ball.spread is not None:
                deviations[members] = ball.spread.sample(
                    (*counts, n) if n > 1 or not p else counts, seed
                ).ravel()[members]
            # twice, so that what remains is zero to the rounding of the deviations, not of the
            # diameters
            deviations[members] -= np.mean(deviations[members])
            deviations[members] -= np.mean(deviations[members])
            least = ball.diameter + float(np.min(deviations[members]))
            if least <= 0.0:
                raise InputError(
                    f"the smallest ball has a diameter of {least:g} m", mend="Give a smaller spread"
                )
        return supercell._derive(deviations=deviations)

    def replace(self, index: Any, ball: Ball) -> Self:
        """Return the crystal with another ball at one site, or at several: a defect.

        ``index`` is the number of a ball, or a list of numbers. A ball of another size must touch
        the same neighbours.
        """
        sites = index_array("index", index, self.n_balls)
        site_balls = list(self.balls)
        if not isinstance(ball, Ball):
            raise InputError(f"{brief(ball)} is not a ball", mend="Give a granphon.Ball")
        for site in sites.tolist():
            if abs(ball.radius - site_balls[site].radius) > 0.5 * TOUCH * ball.radius:
                problem = (
                    f"ball {site} has the radius {site_balls[site].radius:.9g} m, and the new one"
                    f" {ball.radius:.9g} m"
                )
                why = "Its neighbours would overlap or miss it"
                raise InputError(
                    problem,
                    why,
                    "Give a ball of the same size, or a new crystal from cell and positions",
                )
            site_balls[site] = ball
        kinds, kind = find_kinds(site_balls)
        names = dict(zip(self.kinds, self.names, strict=True))
        deviations = self.deviations
        if deviations is not None:
            deviations = np.where(np.isin(np.arange(self.n_balls), sites), 0.0, deviations)
        return self._derive(
            kinds=kinds, kind=kind, names=name_kinds(kinds, names), deviations=deviations
        )

    def with_balls(self, balls: Mapping[str, Ball]) -> Self:
        """Return the crystal with other balls of some kinds, by name, at the same places.

        Raises :class:`~granphon.base.errors.InputError` for what is no mapping of names to balls, a
        name without a kind, and a ball of another diameter.
        """
        kinds = dict(zip(self.names, self.kinds, strict=True))
        replacements: object = balls
        if not isinstance(replacements, Mapping) or not all(
            isinstance(ball, Ball) for ball in replacements.values()
        ):
            mend = (
                f'Give a granphon.Ball for each kind that changes, as {{"{self.names[0]}": ball}}'
            )
            raise InputError(f"the balls are {brief(replacements)}", mend=mend)
        for name, ball in balls.items():
            if name not in kinds:
                raise InputError(
                    f"there is no kind of ball {name!r}", mend=f"Give one of {', '.join(kinds)}"
                )
            if ball.diameter != kinds[name].diameter:
                problem = (
                    f"balls {name!r} of {ball.diameter:g} m do not touch their neighbours where"
                    f" those of "
                )
                why = "Only on a named lattice places follow from diameters"
                raise InputError(
                    f"{problem}{kinds[name].diameter:g} m lie", why, "Make the crystal anew"
                )
        return self._derive(kinds=tuple((kinds | dict(balls)).values()))

    def remove(self, index: Any) -> Self:
        """Return the crystal without a ball, or without several: a vacancy. ``index`` is a number
        or a list of numbers.
        """
        kept = np.ones(self.n_balls, bool)
        kept[index_array("index", index, self.n_balls)] = False
        if not np.any(kept):
            raise InputError("no ball is left", mend="Remove fewer")
        new_numbers = np.cumsum(kept) - 1
        table = self.contacts
        origin = np.flatnonzero(kept)
        rows = np.flatnonzero(kept[table.i] & kept[table.j])
        contacts = table.take(
            rows, new_numbers[table.i[rows]], new_numbers[table.j[rows]], table.shift[rows]
        )
        crystal = self._take(origin, contacts, self.positions[kept])
        crystal._require_joined()
        return crystal

    def cut(self, axis: Any, layers: int, edges: Any = "free") -> Self:
        """Return so many layers of the crystal, which no longer repeat across them: a strip, slab
        or column.

        Parameters
        ----------
        axis : index of the vector of the cell along which layers follow each other; or integer
            Miller indices of their plane, one for each vector of the cell as given, or four in a
            hexagonal cell. The cells of fcc, bcc, diamond and NaCl are primitive: the conventional
            plane (h, k, l) has the indices ``cell @ [h, k, l]``, made whole numbers, in these. So
            fcc's conventional (0, 0, 1) is (1, 1, 0), and (1, 1, 1) is (1, 1, 1).
        layers : their number, in cells.
        edges : how the two faces are held: "free"; "clamped", the outer layer does not move by
            itself; "floor", a rigid plane touches the outer balls. One word for both, or (lower,
            upper).

        The layers follow each other along the first axis that is no longer a period, the lower face
        first: y of what was cut from a plane, z from space, x from a chain. If need be the crystal
        is turned, so that the periods that are left lie along x or in the xy plane. Where both
        faces are walls, a load moves the upper one.

        Raises :class:`~granphon.base.errors.InputError` for an axis that is no period, and if
        layers do not hang together.
        """
        count = whole_number("layers", layers, 1, _MOST_CELLS)
        _require_room(count, self)
        words, layering = require("edges", read_edges, edges), Layers.across(axis, self.cell)
        d = self.dimension
        n = self.n_balls
        across = self.periods - 1
        table = self.contacts
        turn = layering.turn
        stack = layering.stack
        sites, shift = layering.gather(self.positions, table.i, table.j, table.shift)
        i, j, rows, shift = layering.unfold(table.i, table.j, shift, n, count)
        positions = ((sites @ turn.T)[None] + np.arange(count)[:, None, None] * stack).reshape(
            -1, d
        )
        origin = np.tile(np.arange(n), count)
        outer = find_faces(positions[:, across], self._mean_radii[origin], words, n)
        crystal = self._take(
            origin, table.take(rows, i, j, shift, turn), positions, cell=layering.cell
        )
        face = Faces(across, count * abs(float(stack[across])), words, outer)
        crystal = crystal._derive(faces=(*crystal.faces, face))
        crystal._require_joined()
        return crystal

    def _require_joined(self) -> None:
        """Raise :class:`InputError` unless all balls hang together, or stand on a floor or clamp,
        and faces have balls.
        """
        n = self.n_balls
        p = self.periods
        table = self.contacts
        if not all(side.balls.size for side in self._sides):
            problem = f"no ball is left at a face of crystal {self.name!r}"
            why = "It could be neither held nor pressed there"
            raise InputError(problem, why, "Remove balls first, and cut then")
        if not self.n_contacts:
            raise InputError(
                f"no balls of crystal {self.name!r} touch",
                mend="Give more layers, or remove fewer balls",
            )
        held = np.zeros(n, bool)  # by a wall, which extends along all periods
        held[
            np.concatenate(
                [np.zeros(0, np.intp), *(side.balls for side in self._sides if side.edge != "free")]
            )
        ] = True
        if (alone := np.setdiff1d(np.flatnonzero(~held), np.append(table.i, table.j))).size:
            raise InputError(
                f"ball {alone[0]} of crystal {self.name!r} touches no other", mend="Remove it too"
            )
        mend = "Remove one of them, or give more layers"
        require_joined(
            table.i, table.j, table.shift, n, p, f"crystal {self.name!r}", mend=mend, held=held
        )

    # -- what it is --------------------------------------------------------------------------------

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
        """Number of contacts in the cell, those with floors among them, which come last."""
        return len(self.contacts) + sum(len(floor.balls) for floor in self._floors)

    @property
    def measure(self) -> float:
        """Length, area or volume of the cell, m^p; 1 without a period."""
        return abs(float(np.linalg.det(self.cell[:, : self.periods]))) if self.periods else 1.0

    def __repr__(self) -> str:
        kinds = ", ".join(
            f"{np.count_nonzero(self.kind == number)} {name}"
            for number, name in enumerate(self.names)
        )
        summary = (
            f"{counted(self.n_balls, 'ball')} ({kinds}), {counted(self.n_contacts, 'contact')}"
        )
        return f"Crystal({self.name!r}: {summary}, {counted(self.periods, 'period')}, {self.dimension}D)"

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
        """(n,) radii of the balls less those of their kinds, m."""
        return np.zeros(self.n_balls) if self.deviations is None else 0.5 * self.deviations

    @property
    def mindlin_ratios(self) -> Array:
        """(n_c,) shear over normal stiffness of each contact that resists shear: 4 G*/E*, without
        adhesion.
        """
        return np.asarray(self._constants[2])

    @property
    def is_held(self) -> bool:
        """Whether a floor or clamp holds balls of it."""
        return any(side.edge != "free" for side in self._sides)

    @property
    def downward(self) -> Array:
        """(d,) unit vector across the layers of what was cut, towards the face that is held; the
        lower one if both are.

        Raises :class:`~granphon.base.errors.InputError` if no face is.
        """
        for side in self._sides:
            if side.edge != "free":
                return np.asarray(side.sign * np.eye(self.dimension)[side.axis])
        problem = f"nothing holds crystal {self.name!r} against gravity"
        error = InputError(
            problem, mend='Cut it with a floor or clamp: c.cut(axis, layers, ("floor", "free"))'
        )
        error.block = ("load", "gravity")
        raise error

    @cached_property
    def masses(self) -> Array:
        """(n,) masses, kg."""
        return read_only(np.array([ball.mass for ball in self.kinds])[self.kind])

    @cached_property
    def _sides(self) -> list[Side]:
        """The faces of all cuts, the lower before the upper of each."""
        sides = list[Side]()
        walls = 0
        for face in self.faces:
            for sign, edge, balls in zip((-1.0, 1.0), face.edges, face.balls, strict=True):
                sides.append(
                    Side(
                        face.axis,
                        sign,
                        edge,
                        balls,
                        walls if face.is_pressed and sign > 0.0 else -1,
                    )
                )
            walls += face.is_pressed
        return sides

    @property
    def _floors(self) -> list[Side]:
        return [side for side in self._sides if side.edge == "floor"]

    @cached_property
    def _pairs(self) -> tuple[list[tuple[Body, Body, str, str]], Index]:
        """The different pairs of kinds that touch, with their names, and the number (n_c,) of the
        pair of each contact.
        """
        table = self.contacts
        m = len(self.kinds)
        one = self.kind[table.i]
        other = self.kind[table.j]
        at_floor = np.concatenate(
            [np.zeros(0, np.intp), *(self.kind[one.balls] for one in self._floors)]
        )
        low = np.concatenate([np.minimum(one, other), at_floor])
        high = np.concatenate([np.maximum(one, other), np.full(len(at_floor), m)])
        keys, number = np.unique(low * (m + 1) + high, return_inverse=True)
        bodies: list[Body] = [*self.kinds, RIGID_PLANE]
        names = [*self.names, RIGID_PLANE.name]
        pairs = [
            (bodies[a], bodies[b], names[a], names[b])
            for a, b in (divmod(key, m + 1) for key in keys.tolist())
        ]
        return pairs, number.astype(np.intp)

    @cached_property
    def _springs(self) -> Springs:
        """The law of each contact."""
        pairs, number = self._pairs
        laws: list[PairLaw] = []
        checked: set[int] = set()
        for first, second, first_name, second_name in pairs:
            found = law_of_pair(self.law, first, second, first_name, second_name)
            if id(found) not in checked:
                check_law(found, ContactConstants.of(first, second).radius)
                checked.add(id(found))
            laws.append(found)
        order = np.argsort(number, kind="stable")
        split = np.split(order, np.searchsorted(number[order], np.arange(1, len(pairs))))[
            : len(pairs)
        ]
        return Springs(
            [(law, at) for law, at in zip(laws, split, strict=True)],
            len(number),
            self._constants[0],
        )

    def law_of(self, i: int, j: int) -> tuple[PairLaw, float, float]:
        """Return the law of balls i and j, 4 G*/E*, and E*, Pa; numbers from that of the balls on
        are floors.
        """
        names = [
            self.names[self.kind[end]] if end < self.n_balls else RIGID_PLANE.name for end in (i, j)
        ]
        return self.contact_model.law_of(names[0], names[1])

    def touch(self) -> CrystalState:
        """Return the crystal as its balls touch, without load; stiffnesses are those at overlaps of
        1e-6 of distances.
        """
        frame = self._frame[0]
        springs = self._springs
        overlap = TOUCH * frame.distance
        d = self.dimension
        p = self.periods
        unit = frame.vector / np.linalg.norm(frame.vector, axis=1, keepdims=True)
        return CrystalState(
            self,
            springs.force(overlap),
            overlap,
            springs.stiffness(overlap),
            unit,
            np.zeros((self.n_balls, d)),
            np.zeros((p, p)),
            np.zeros((p, p)),
            np.zeros(len(frame.walls)),
        )

    @cached_property
    def contact_model(self) -> ContactModel:
        """The kinds and the laws of their contacts, which networks of the crystal have too."""
        return ContactModel(
            self.kinds, self.names, self.law, self.friction, self.torsion, self.bending
        )

    @cached_property
    def _constants(self) -> Array:
        """(4, n_c) E*, R, kappa/k and the modulus of twist of each contact."""
        pairs, number = self._pairs
        constants = [ContactConstants.of(first, second) for first, second, _, _ in pairs]
        return np.reshape(constants, (-1, 4))[number].T

    @cached_property
    def ball_motions(self) -> Motions:
        """The motions of each ball, without rotations if no contact resists any."""
        allowed = allowed_motions(self.dimension)
        among = next(iter(allowed.values())) if self.motions is None else allowed[self.motions]
        return select_motions(
            1.0 if self.friction else 0.0, 1.0 if self.torsion else 0.0, self.bending, among
        )

    @cached_property
    def _frame(self) -> tuple[Frame, Index, Index]:
        """The unknowns of the statics, the place of each ball among displacements (-1: held), and
        its wall (-1: none).
        """
        if self.deviations is None and any(
            ball.spread is not None and ball.spread.rms for ball in self.kinds
        ):
            problem = (
                f"balls of crystal {self.name!r} have a spread of diameters, and none are drawn"
            )
            raise InputError(
                problem,
                "Each ball is simulated by itself",
                "Draw them: crystal.sample((8, 8), seed=0)",
            )
        n = self.n_balls
        d = self.dimension
        p = self.periods
        table = self.contacts
        radii = self._mean_radii
        bulges = self._bulges
        place = np.zeros(n, np.intp)
        rider = np.full(n, -1, np.intp)
        # axis, balls: those that move
        walls = [(face.axis, len(face.balls[1])) for face in self.faces if face.is_pressed]
        for side in self._sides:
            if side.edge == "clamped":
                place[side.balls], rider[side.balls] = -1, side.wall
        free = place == 0
        place[free] = np.arange(np.count_nonzero(free))
        n_free = d * int(np.count_nonzero(free))
        pairs = tuple((a, b) for a in range(p) for b in range(a, p))
        # forces on strains, sums over all contacts, are then of the size of those on balls, root of
        # n as these are in sum
        length = 2.0 * float(np.mean(radii)) * math.sqrt(max(len(table), 1))
        first_wall = n_free + len(pairs)
        parts: list[tuple[Any, Any, Any]] = []
        rows = np.arange(len(table)) * d
        for ends, sign in ((table.j, 1.0), (table.i, -1.0)):
            moves = place[ends] >= 0
            for a in range(d):
                parts.append((rows[moves] + a, d * place[ends[moves]] + a, sign))
            rides = rider[ends] >= 0
            if np.any(rides):
                across = np.array([one for one, _ in walls])[rider[ends[rides]]]
                parts.append((rows[rides] + across, first_wall + rider[ends[rides]], sign))
        for number, (a, b) in enumerate(pairs):
            parts.append((rows + a, n_free + number, table.vector[:, b] / length))
            if a != b:
                parts.append((rows + b, n_free + number, table.vector[:, a] / length))
        vectors = [table.vector]
        start = len(table)
        offsets = [bulges[table.i] + bulges[table.j]]
        for axis, sign, _, at, wall in self._floors:
            own = (start + np.arange(len(at))) * d + axis
            moves = place[at] >= 0
            parts.append((own[moves], d * place[at[moves]] + axis, -1.0))
            if wall >= 0:
                parts.append((own, first_wall + wall, 1.0))
            vectors.append(sign * radii[at, None] * np.eye(d)[axis])
            offsets.append(bulges[at])
            start += len(at)
        vector = np.concatenate(vectors)
        flat = np.arange(len(vector)) >= len(table)
        motion = compose(parts, (len(vector) * d, first_wall + len(walls)))
        counts = tuple(count for _, count in walls)
        frame = Frame(
            vector,
            flat,
            motion,
            d,
            self.cell[:, :p],
            n_free,
            pairs,
            counts,
            length,
            np.concatenate(offsets),
        )
        return frame, place, rider

    # -- under load --------------------------------------------------------------------------------

    def at_pressure(
        self,
        pressure: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
    ) -> CrystalState:
        """Return the state at rest under a hydrostatic pressure.

        Parameters
        ----------
        pressure : P, Pa in space, N/m in the plane, N on a line; one value or an array. On a cut
            crystal it also acts on both faces; on a free face the outer balls share it equally.
        gravity : (d,) the acceleration, m/s^2, of a crystal that stands on a floor or clamp, or
            (..., d), of which there is one for each load. Then the periods keep the length at which
            balls touch, as between walls, P acts on the upper face alone, and may be zero.
        finite_overlap : the true geometry: contacts turn, the cell deforms, P acts on the deformed
            cell, and static forces enter the response. By default overlaps are small, which drops
            terms of relative order delta/d.

        Raises
        ------
        InputError : a pressure that is not above zero (zero or above with gravity; any if contacts
            adhere or are bonds), gravity that nothing holds, or forces that contacts cannot bear.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        """
        values, fields = self._read_gravity(finite_array("pressure", pressure), gravity)
        if np.any(values):
            self._require_pressable()
        adhere = self._springs.adhere
        if np.any(values < 0.0) and not adhere:
            problem = f"pressure is {brief(values.tolist())}: tensile"
            raise InputError(
                problem, "One-sided contacts carry no tension", "Give a pressure above zero"
            )
        if not adhere and any(
            one == 0.0 and field is None for one, field in zip(values.flat, fields, strict=True)
        ):
            why = "Balls that only touch have no stiffness, and carry no sound"
            raise InputError("pressure is zero", why, "Press them, or give gravity and a floor")

        loads = zip(values.ravel().tolist(), fields, strict=True)
        pushes = (
            self._push_hydrostatic(one, field, f"a pressure of {one:g}") for one, field in loads
        )
        return self._solve_each(values, pushes, finite_overlap)

    def at_force(
        self,
        force: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
    ) -> CrystalState:
        """Return the state at rest under that hydrostatic pressure at which contacts carry the mean
        ``force``, N.

        The mean is that over the contacts that carry a load, or touch if they adhere; of balls that
        differ in diameter that over all contacts. ``gravity``, ``finite_overlap`` and the errors
        are as in :meth:`at_pressure`.
        """
        return self._at_mean("force", force, gravity, finite_overlap)

    def at_overlap(
        self,
        overlap: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        finite_overlap: bool | None = None,
    ) -> CrystalState:
        """Return the state at which contacts have the mean ``overlap``, m; see :meth:`at_force`,
        ``gravity`` too.
        """
        return self._at_mean("overlap", overlap, gravity, finite_overlap)

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
            xz, xy; or an array of these. Pa in space, N/m in the plane, N on a line. Of what was
            cut it is that along the periods that are left, and the faces are not pressed.
        gravity : m/s^2, of a crystal that stands on a floor or clamp; see :meth:`at_pressure`.
        finite_overlap : see :meth:`at_pressure`; the stress is then Cauchy's, on the deformed cell.

        Raises
        ------
        InputError : an array of another shape; a stress that contacts cannot bear, because they
            only push along the lines of their centres.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        """
        values, fields = self._read_gravity(self._read_tensor("stress", stress, 1.0), gravity, 2)

        def name(tensor: Array) -> str:
            rounded = np.round(tensor, 12) if np.max(np.abs(tensor)) > 1e-6 else tensor
            return f"the stress {brief(rounded.tolist())} {('', 'N', 'N/m', 'Pa')[self.periods]}"

        loads = zip(values.reshape(-1, *values.shape[-2:]), fields, strict=True)
        pushes = (self._push(name(tensor), field, stress=tensor) for tensor, field in loads)
        return self._solve_each(values, pushes, finite_overlap, 2)

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
            for xx, yy, zz, 2yz, 2xz, 2xy; or an array of these. It is measured from the cell in
            which balls only touch.
        gravity, finite_overlap : see :meth:`at_stress`.

        Raises
        ------
        InputError : an array of another shape; a strain that opens all contacts, or shortens a
            period to nothing.
        ConvergenceError, InstabilityError : the crystal does not come to rest.
        """
        values, fields = self._read_gravity(self._read_tensor("strain", strain, 0.5), gravity, 2)
        least = float(np.min(np.linalg.eigvalsh(values)))
        if least <= -1.0:
            problem = f"strain shortens crystal {self.name!r} by {-least:.4g} of its length"
            raise InputError(problem, "Nothing would be left of it", "Give a strain above -1")

        loads = zip(values.reshape(-1, *values.shape[-2:]), fields, strict=True)
        pushes = (
            self._push(f"the strain {brief(tensor.tolist())}", field, strain=tensor)
            for tensor, field in loads
        )
        return self._solve_each(values, pushes, finite_overlap, 2)

    def _read_tensor(self, name: str, values: ArrayLike, shear: float) -> Array:
        """Return tensors (..., p, p), from these or from Voigt's order, in which shears count by
        the factor ``shear``.
        """
        p = self.periods
        if not p:
            raise InputError(
                f"crystal {self.name!r} has no period that a {name} could act on",
                mend="Give a pressure",
            )
        tensors = finite_array(name, values)
        voigt = voigt_pairs(p)
        if p == 1 and tensors.ndim == 0:
            tensors = tensors[None]
        if tensors.shape[-2:] == (p, p):
            if np.any(
                np.abs(tensors - np.swapaxes(tensors, -1, -2)) > 1e-12 * np.max(np.abs(tensors))
            ):
                raise InputError(f"{name} is not symmetric", mend="Give a symmetric matrix")
            return tensors
        if tensors.shape[-1:] != (len(voigt),):
            problem = f"{name} has the shape {tensors.shape}"
            raise InputError(
                problem,
                mend=f"Give ({p}, {p}), or ({len(voigt)},) in Voigt order, or an array of these",
            )
        full = np.zeros((*tensors.shape[:-1], p, p))
        for number, (a, b) in enumerate(voigt):
            full[..., a, b] = full[..., b, a] = tensors[..., number] * (1.0 if a == b else shear)
        return full

    def _read_gravity(
        self, values: Array, gravity: ArrayLike | None, rank: int = 0
    ) -> tuple[Array, list[Array | None]]:
        """Return loads, whose last ``rank`` axes are those of one, broadcast with gravity, and this
        at each, or None.
        """
        load_shape = values.shape[: values.ndim - rank]
        if gravity is None:
            return values, [None] * math.prod(load_shape)
        field = finite_array("gravity", gravity)
        d = self.dimension
        p = self.periods
        field = field[..., None] if d == 1 and field.shape[-1:] != (1,) else field
        try:
            shape = (
                np.broadcast_shapes(load_shape, field.shape[:-1])
                if field.shape[-1:] == (d,)
                else None
            )
        except ValueError:
            shape = None
        if shape is None:
            problem = f"gravity has the shape {field.shape}" + (
                f", and the loads {load_shape}" if load_shape else ""
            )
            raise InputError(
                problem, mend=f"Give its {counted(d, 'component')}, m/s^2, as (0, -9.81) in a plane"
            )
        across = np.abs(field) > 1e-12 * np.max(np.abs(field), axis=-1, keepdims=True)
        walls = {one.axis for one in self._sides if one.edge != "free"}
        for axis in np.flatnonzero(np.any(across.reshape(-1, d), axis=0)).tolist():
            if axis < p or (
                axis not in walls and not any("clamped" in face.edges for face in self.faces)
            ):
                reason = "repeats" if axis < p else "stands on nothing"
                problem = f"gravity acts along {'xyz'[axis]}, where crystal {self.name!r} {reason}"
                mend = (
                    'Cut it, and let it stand: crystal.cut(axis, layers, edges=("floor", "free"))'
                )
                raise InputError(problem, "Nothing holds the balls there", mend)
        fields = np.broadcast_to(field, (*shape, d)).reshape(-1, d)
        return np.broadcast_to(values, shape + values.shape[len(load_shape) :]), [
            one if np.any(one) else None for one in fields
        ]

    def _push(
        self,
        words: str,
        field: Array | None,
        stress: Array | None = None,
        strain: Array | None = None,
        pressure: float = 0.0,
    ) -> Push:
        """Return the load of gravity, a ``stress`` or ``strain`` (p, p) of the periods, and a
        pressure on the faces.
        """
        frame, place, _ = self._frame
        lifted: tuple[str, str] | None = (
            None  # why gravity lifts balls off what they stand on, and what mends it
        )
        force, pressed, held_values = np.zeros((3, frame.motion.shape[1]))
        held = np.zeros(len(force), bool)
        if field is not None:
            force[: frame.n_free] = (self.masses[place >= 0, None] * field).ravel()
            for face in self.faces:
                low, high = face.edges
                pull = field[face.axis] if low != "free" else -field[face.axis]
                cross_section = math.prod(side.thickness for side in self.faces if side is not face)
                weight = (
                    float(np.sum(self.masses[place >= 0])) * pull / (self.measure * cross_section)
                )
                if (
                    lifted is None
                    and pull > 0.0
                    and pressure <= weight
                    and (low, high) != ("clamped", "clamped")
                ):
                    unit = ("N", "N/m", "Pa")[self.periods + len(self.faces) - 1]
                    word, sign = (low, "") if low != "free" else (high, "-")
                    why = (
                        f"Gravity acts along {sign}{'xyz'[face.axis]}, away from the {word} on"
                        f" which the balls stand"
                    )
                    lifted = (
                        why,
                        f"Turn it round, or press with more than their weight, {weight:.4g} {unit}",
                    )
        if stress is not None:
            force[frame.strains] += frame.work_of(stress)
        if strain is not None:
            held[frame.strains] = True
            held_values[frame.strains] = [strain[a, b] * frame.length for a, b in frame.pairs]
        for side in self._sides:
            push = (
                pressure
                * frame.measure
                * math.prod(face.thickness for face in self.faces if face.axis != side.axis)
            )
            if side.wall >= 0:
                pressed[frame.strains.stop + side.wall] -= push
            elif side.edge == "free":
                numbers = place[side.balls][place[side.balls] >= 0]
                pressed[self.dimension * numbers + side.axis] -= (
                    side.sign * push / max(len(numbers), 1)
                )
        if not np.all(np.isfinite(force + pressed)):
            raise FloatingPointError(f"the forces of {words} are not finite")
        return Push(force + pressed, held, held_values, stress, pressed, words, lifted)

    def _push_hydrostatic(self, pressure: float, field: Array | None, words: str) -> Push:
        words += f" {('N', 'N', 'N/m', 'Pa')[self.periods + len(self.faces)]}"
        if field is not None:
            return self._push(
                f"{words} with gravity",
                field,
                strain=np.zeros((self.periods,) * 2),
                pressure=pressure,
            )
        stress = -pressure * np.eye(self.periods) * math.prod(face.thickness for face in self.faces)
        return self._push(words, None, stress, pressure=pressure)

    def _at_mean(
        self, kind: str, values: ArrayLike, gravity: ArrayLike | None, finite_overlap: bool | None
    ) -> CrystalState:
        """Return the state at which contacts have a mean force or overlap, by a search for the
        pressure.
        """
        goals, fields = self._read_gravity(finite_array(kind, values), gravity)
        self._require_pressable()
        if np.any(goals <= 0.0):
            word = "zero" if np.any(goals == 0.0) else f"{brief(goals.tolist())}: tensile"
            why = "One-sided contacts carry no tension"
            mend = f"Give {kind} above zero"
            if self._springs.adhere:
                why = "A mean of contacts that adhere has no one pressure there"
                mend = "Use at_pressure, which may be zero or below"
            raise InputError(f"{kind} is {word}", why, mend)
        follows = read_finite_overlap(finite_overlap)
        frame = self._frame[0]
        springs = self._springs
        with _in_double_precision(goals):
            loads = zip(goals.ravel().tolist(), fields, strict=True)
            solutions = [
                self._find_mean(kind, goal, field, follows, frame, springs) for goal, field in loads
            ]
            return self._stack(goals, solutions, 0, follows)

    def _require_pressable(self) -> None:
        if not (self.periods or self.faces):
            raise InputError(
                f"crystal {self.name!r} has neither periods nor faces to press on",
                mend="Give a cell",
            )

    def _find_mean(
        self,
        kind: str,
        goal: float,
        field: Array | None,
        follows: bool,
        frame: Frame,
        springs: Springs,
    ) -> tuple[Rest, Push]:
        words = f"a mean {kind} of {goal:g} {'N' if kind == 'force' else 'm'}, at a pressure of"
        size = goal
        if kind == "overlap":
            size = float(np.mean(springs.force(np.full(springs.count, goal))))
        # the pressure of a contact force, from the virial; of a column, that force
        area = frame.measure * math.prod(face.thickness for face in self.faces)
        dimension = self.periods + len(self.faces)
        pressure = size * float(np.sum(frame.distance)) / (dimension * area)
        low = 0.0
        high = math.inf
        start: Rest | None = None
        rest: Rest | None = None
        last = math.inf
        before = (0.0, math.nan)
        differ = bool(np.any(frame.offset))
        enough = _SAMPLED if differ else _MEAN
        for _ in range(_MEANS):
            push = self._push_hydrostatic(pressure, field, f"{words} {pressure:.6g}")
            small = settle(frame, springs, push, start)
            # from the last one where balls differ: their mean would jump with the places of loose
            # balls
            rest = (
                settle_exactly(frame, springs, push, rest if differ and rest else small)
                if follows
                else small
            )
            force = springs.force(rest.overlap)
            stiffness = springs.stiffness(rest.overlap)
            loaded = (stiffness > 0.0 if springs.adhere else force != 0.0) | differ
            if not np.any(loaded):
                what = f"all contacts are open under {words} {pressure:.6g}"
                raise InputError(what, "Those that adhere have come apart", f"Give a larger {kind}")
            mean = float(np.mean((force if kind == "force" else rest.overlap)[loaded]))
            off = mean / goal - 1.0
            rounded = 1e-13
            if differ:  # loose balls leave more, of the parts of the mean
                rounded = (
                    10.0
                    * _SAMPLED
                    * max(1.0, float(np.mean(np.abs(rest.overlap)) / np.abs(np.mean(rest.overlap))))
                )
            if springs.adhere:  # the mean may be small against its parts, attraction and repulsion
                parts = np.abs(
                    stiffness * rest.overlap
                    if kind == "force"
                    else force / np.where(loaded, stiffness, np.inf)
                )
                rounded *= max(1.0, float(np.mean(parts[loaded])) / goal)
            if abs(off) <= enough or (abs(off) <= rounded and abs(off) >= last):
                return rest, push
            if field is not None and off > 0.0 and abs(off - last) <= rounded * off:
                # gravity alone presses more than is wanted, and less pressure changes nothing
                break
            last = abs(off)
            low, high = (pressure, high) if off < 0.0 else (low, pressure)
            # overlaps go as a power of the pressure, f/(k delta), and so does the start of the next
            # state
            power = float(np.mean(force[loaded]) / np.mean((stiffness * rest.overlap)[loaded]))
            grow = goal / mean if mean / goal > 0.0 else 2.0
            new = pressure * (grow if kind == "force" else grow ** (1.0 / power))
            factor = grow**power if kind == "force" else grow
            if differ:  # overlaps on the sites do not grow, and their mean follows no power
                factor = 1.0
                if math.isfinite(before[1]) and mean != before[1]:
                    new = pressure + (goal - mean) * (pressure - before[0]) / (mean - before[1])
                before = pressure, mean
            start = Rest(factor * small.x, factor * small.overlap, small.normal)
            pressure = new if low < new < high else 0.5 * (low + min(high, 2.0 * pressure))
            if pressure in (low, high):
                if abs(off) <= rounded:
                    return rest, push
                break
        what = (
            f"contacts of crystal {self.name!r} do not have a mean {kind} of {goal:g} at any"
            f" pressure"
        )
        why = f"At a pressure of {pressure:.4g} it is {mean:.4g}" + ", as gravity presses more" * (
            field is not None
        )
        raise InputError(what, why, "Give a larger one" if field is not None else "")

    def _solve_each(
        self, values: Array, pushes: Iterable[Push], finite_overlap: bool | None, rank: int = 0
    ) -> CrystalState:
        """Return the state at each load: ``pushes`` are those of the values, or of tensors of
        ``rank`` 2.
        """
        follows = read_finite_overlap(finite_overlap)
        frame = self._frame[0]
        springs = self._springs
        solutions = []
        with _in_double_precision(values):
            for push in pushes:
                rest = settle(frame, springs, push)
                solutions.append(
                    (settle_exactly(frame, springs, push, rest) if follows else rest, push)
                )
            return self._stack(values, solutions, rank, follows)

    def _stack(
        self, values: Array, solutions: Sequence[tuple[Rest, Push]], rank: int, follows: bool
    ) -> CrystalState:
        """Return the state of some loads, with the shape of ``values``, whose last ``rank`` axes
        are those of one.
        """
        frame, place, rider = self._frame
        load_shape = values.shape[: values.ndim - rank]
        d = self.dimension
        p = self.periods
        springs = self._springs
        displacements = np.zeros((len(solutions), self.n_balls, d))
        wall_motions = np.zeros((len(solutions), len(frame.walls)))
        strain, stress = np.zeros((2, len(solutions), p, p))
        for index, (rest, _) in enumerate(solutions):
            displacements[index, place >= 0] = rest.x[: frame.n_free].reshape(-1, d)
            wall_motions[index] = rest.x[frame.strains.stop :]
            strain[index] = frame.strain(rest.x)
            force = springs.force(rest.overlap)
            if p:
                deformed = np.eye(p) + strain[index] if follows else np.eye(p)
                virial = (force[:, None] * rest.normal[:, :p]).T @ np.where(
                    frame.flat[:, None], 0.0, frame.vector[:, :p]
                )
                virial = virial @ deformed.T
                stress[index] = (
                    -0.5 * (virial + virial.T) / (frame.measure * float(np.linalg.det(deformed)))
                )
        for side in self._sides:
            if side.wall >= 0:
                displacements[:, rider == side.wall, side.axis] = wall_motions[:, side.wall, None]
        # a motion of the whole crystal means nothing where no wall is in its way
        if not any("clamped" in face.edges for face in self.faces):
            loose = np.setdiff1d(np.arange(d), [side.axis for side in self._floors])
            displacements[..., loose] -= np.mean(displacements[..., loose], axis=1, keepdims=True)
        overlap = np.array([rest.overlap for rest, _ in solutions])
        force = np.array([springs.force(side) for side in overlap])
        stiffness = np.array([springs.stiffness(side) for side in overlap])
        normal = np.array([rest.normal for rest, _ in solutions])
        deep = np.max(overlap / frame.distance, axis=1)
        modulus = min(ball.material.young_modulus for ball in self.kinds)
        require_shallow(modulus, float(np.max(deep)), solutions[int(np.argmax(deep))][1].words)

        values_of = zip(
            _PER_LOAD,
            (force, overlap, stiffness, normal, displacements, stress, strain, wall_motions),
            strict=True,
        )
        shaped: dict[str, Any] = {
            name: read_only(array.reshape(*load_shape, *array.shape[1:]))
            for name, array in values_of
        }
        return CrystalState(self, **shaped, finite_overlap=follows)


@dataclass(frozen=True, eq=False, repr=False)
class CrystalState(Result):
    """The contacts of a crystal under load, as its methods ``at_...`` return it.

    Attributes
    ----------
    crystal : the :class:`~granphon.Crystal`.
    normal_force : (..., n_c) forces of the contacts, N, those with floors last; 0 where a contact
        is open, below 0 where it adheres. "..." is the shape of the load.
    overlap : (..., n_c) m; zero or below of an open contact.
    normal_stiffness : (..., n_c) N/m; 0 where a contact is open.
    normal : (..., n_c, d) unit vectors from ball i to ball j, or into the floor.
    displacements : (..., n, d) of the balls from where they touch, beside the strain of the cell,
        m.
    stress : (..., p, p) Pa, N/m or N along three, two or one periods; tension is positive. With
        finite overlap it is Cauchy's.
    strain : (..., p, p) of the periods, from where balls only touch; extension is positive.
    ways : (..., n_w) displacement of each upper wall whose lower face is a wall too, m.
    finite_overlap : whether contacts have turned and the cell has deformed. If not, the network has
        the places at which balls touch, which drops terms of relative order delta/d.
    """

    crystal: Crystal
    normal_force: Annotated[Array, "... c", "N", "finite"]
    overlap: Annotated[Array, "... c", "m", "finite"]
    normal_stiffness: Annotated[Array, "... c", "N/m", "zero or above"]
    normal: Annotated[Array, "... c d", "", "finite"]
    displacements: Annotated[Array, "... n d", "m", "finite"]
    stress: Annotated[Array, "... p p", "", "finite"]
    strain: Annotated[Array, "... p p", "", "finite"]
    ways: Annotated[Array, "... w", "m", "finite"]
    finite_overlap: bool = False

    def _field_units(self) -> dict[str, str]:
        return {**self.units, "stress": ("", "N", "N/m", "Pa")[self.crystal.periods]}

    def __getitem__(self, index: Any) -> CrystalState:
        """Return the state at some of the loads, indexed like an array."""
        if self.is_single:
            raise InputError("the state has one load, and no index", mend="Use it as it is")
        count = int(np.prod(self.shape))
        axes = len(self.shape)
        chosen_loads = np.arange(count).reshape(self.shape)[index]
        if not np.size(chosen_loads):
            raise InputError(
                f"the index {brief(index)} selects none of the loads", mend="Select one or more"
            )
        arrays = {name: getattr(self, name) for name in _PER_LOAD}
        chosen: Any = {
            name: read_only(a.reshape(count, *a.shape[axes:])[chosen_loads])
            for name, a in arrays.items()
        }
        return replace(self, **chosen)

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
        """(..., n_c) kappa = 8 G* a of the :attr:`contact_radius` a, N/m; zero without friction."""
        return self._punch * (self.crystal._constants[2] if self.crystal.friction else 0.0)

    @cached_property
    def _punch(self) -> Array:
        """(..., n_c) stiffness 2 E* a of a flat punch as wide as the contact, N/m."""
        springs = self.crystal._springs
        if not springs.know_radii:
            return self.normal_stiffness
        stiffnesses = np.empty(self.normal_stiffness.shape)
        for index in np.ndindex(self.shape):
            stiffnesses[index] = springs.punch(self.overlap[index])
        return read_only(stiffnesses)

    @property
    def torsion_stiffness(self) -> Array:
        """(..., n_c) stiffness against twist, N m."""
        twist_modulus = self.crystal._constants[3]
        distance = self.crystal._frame[0].distance
        return self.crystal.contact_model.find_torsion(
            self.normal_stiffness, distance, self.contact_radius, twist_modulus
        )

    @property
    def bending_stiffness(self) -> Array:
        """(..., n_c) stiffness against rolling, N m."""
        return self.crystal.contact_model.find_bending(
            self.normal_stiffness, self.crystal._frame[0].distance
        )

    @property
    def contact_radius(self) -> Array:
        """(..., n_c) radius of the contact, m: that of the law, or k/2E* of one that does not know
        it.
        """
        return np.asarray(self._punch / (2.0 * self.crystal._constants[0]))

    @property
    def exponent(self) -> Any:
        """The exponent d log v / d log P of all sound velocities, if the load grows as a whole,
        without terms of delta/d.

        It is f k'/2k^2 of a contact, with the slope k' of its law: (a - 1)/2a where f goes as
        delta^a. Raises :class:`~granphon.base.errors.InputError` if contacts do not have it in
        common: velocities are then no power.
        """
        exponents = np.empty(self.shape)
        for index in np.ndindex(self.shape):
            force = self.normal_force[index]
            k = self.normal_stiffness[index]
            loaded = k > 0.0
            slope = self.crystal._springs.stiffness_slope(self.overlap[index])
            contact_exponents = 0.5 * (force[loaded] / k[loaded]) * (slope[loaded] / k[loaded])
            if np.ptp(contact_exponents) > _SAME_EXPONENT:
                problem = (
                    f"the exponents of contacts differ, from {np.min(contact_exponents):.6g} to"
                    f" {np.max(contact_exponents):.6g}"
                )
                raise InputError(
                    problem, "Their laws are not one power", "Compare the velocities at two loads"
                )
            exponents[index] = np.mean(contact_exponents)
        return exponents[()]

    @property
    def scales(self) -> Units:
        """Reduced units at one load, as of the :attr:`network`.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """
        return self.network.scales

    @cached_property
    def limits(self) -> tuple[Check, ...]:
        """What limits the state, as conditions.

        They are the contact radius over the radius of the ball, the overlap over the last overlap
        of a tabulated law, and the mean pressure of a contact over the yield strength, each the
        largest over the contacts; and material constants that no solid has.
        """
        crystal = self.crystal
        table = self.crystal.contacts
        at = [one.balls for one in crystal._floors]
        small = np.concatenate(
            [np.minimum(table.arm_i, table.arm_j), *(crystal._mean_radii[one] for one in at)]
        )
        out = [check_limit("contact_radius", np.max(self.contact_radius / small, axis=-1))]
        if np.any(np.isfinite(crystal._springs.most)):
            out.append(
                check_limit(
                    "table", np.max(np.maximum(self.overlap, 0.0) / crystal._springs.most, axis=-1)
                )
            )
        for name, (attribute, _, _, limit, at_least) in BALL_LIMITS.items():
            for ball, called in zip(crystal.kinds, crystal.names, strict=True):
                value = attrgetter(attribute)(ball)
                if (value < limit) if at_least else (value > limit):
                    out.append(check_limit(name, np.full(self.shape, value), f" (ball {called})"))
        strengths = [one.material.yield_strength for one in crystal.kinds]
        if any(strengths):
            yields = np.array([math.inf if one is None else one for one in strengths])[crystal.kind]
            weak = np.concatenate(
                [np.minimum(yields[table.i], yields[table.j]), *(yields[one] for one in at)]
            )
            area = math.pi * self.contact_radius**2
            mean = np.divide(self.normal_force, area, out=np.zeros_like(area), where=area > 0.0)
            out.append(check_limit("yield", np.max(mean / weak, axis=-1)))
        return tuple(out)

    @property
    def valid(self) -> Any:
        """Whether the state is inside the range of its contact laws, at each load; :attr:`warnings`
        say why not.

        The contact radius must be no more than a tenth of the radius of a ball, the mean pressure
        of a contact below 1.07 of the yield strength, if that is given, and the overlap within the
        table of a tabulated law. A diameter, density or Young modulus that no solid ball has, so
        that its unit is probably wrong, is not valid either.
        """
        met = np.all([check.ok for check in self.limits], axis=0)
        return bool(met) if self.is_single else met

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about the state, in words; empty if nothing is."""
        return tuple(said for check in self.limits if (said := check.warning) is not None)

    @cached_property
    def _clamped(self) -> Flags:
        """(n,) which balls are held."""
        held = np.zeros(self.crystal.n_balls, bool)
        for side in self.crystal._sides:
            held[side.balls] |= side.edge == "clamped"
        return held

    @cached_property
    def _kept(self) -> Flags:
        """(n_c,) which contacts the network has: those that are closed, and not of two bodies that
        are held.
        """
        held = self._clamped
        table = self.crystal.contacts
        between = [
            held[table.i] & held[table.j],
            *(held[one.balls] for one in self.crystal._floors),
        ]
        return np.asarray((self.normal_stiffness > 0.0) & ~np.concatenate(between))

    @cached_property
    def network(self) -> ContactNetwork:
        """The cell as a :class:`~granphon.ContactNetwork`, without contacts that are open.

        Walls are bodies of infinite mass and radius, after the balls; balls of a clamped layer have
        an infinite mass. Its ``kinds`` are the names of the crystal, and "floor". Raises
        :class:`~granphon.base.errors.InputError` for several loads.
        """
        if not self.is_single:
            what = f"the state holds {int(np.prod(self.shape))} loads"
            why = "A network, atoms and phonons belong to one"
            mend = (
                "Make a state with one load, as crystal.at_pressure(1e5) does, or take one of"
                " these: state[0]"
            )
            raise InputError(what, why, mend)
        crystal = self.crystal
        table = self.crystal.contacts
        follows = self.finite_overlap
        n = crystal.n_balls
        d = crystal.dimension
        p = crystal.periods
        floors = crystal._floors
        deformed = np.eye(d)
        deformed[:p, :p] += self.strain if follows else 0.0
        places = crystal.positions @ deformed.T + (self.displacements if follows else 0.0)
        held = self._clamped
        extra = len(floors)
        positions = np.zeros((n + extra, 3))
        cell = np.zeros((3, 3))
        positions[:n, :d], cell[:p, :d] = places, crystal.cell @ deformed.T
        masses = np.append(np.where(held, np.inf, crystal.masses), np.full(extra, np.inf))
        inertias = np.append(
            np.array([one.inertia for one in crystal.kinds])[crystal.kind], np.full(extra, np.inf)
        )
        radii = np.append(crystal.radii, np.full(extra, np.inf))
        i = [table.i]
        j = [table.j]
        arm_i = [table.arm_i]
        arm_j = [table.arm_j]
        for number, (axis, sign, _, at, _) in enumerate(floors):
            i.append(at)
            j.append(np.full(len(at), n + number))
            arm_i.append(crystal._mean_radii[at])
            arm_j.append(np.zeros(len(at)))
            positions[n + number, axis] = np.mean(
                positions[at, axis] + sign * crystal._mean_radii[at]
            )
        ends = np.concatenate(i), np.concatenate(j)
        shift = np.zeros((crystal.n_contacts, 3), np.intp)
        normal = np.zeros((crystal.n_contacts, 3))
        shift[: len(table), :p], normal[:, :d] = table.shift, self.normal
        # radii less half of the overlap each in the true geometry
        half = 0.5 * self.overlap if follows else 0.0
        bulges = np.append(crystal._bulges, np.zeros(extra)) * follows
        kept = self._kept
        allowed = allowed_motions(d)
        fields: dict[str, Any] = {
            "i": ends[0],
            "j": ends[1],
            "shift": shift,
            "normal": normal,
            "normal_force": self.normal_force,
            "normal_stiffness": self.normal_stiffness,
            "shear_stiffness": self.shear_stiffness,
            "torsion_stiffness": self.torsion_stiffness,
            "bending_stiffness": self.bending_stiffness,
            "arm_i": np.concatenate(arm_i) + bulges[ends[0]] - half,
            "arm_j": np.concatenate(arm_j) + bulges[ends[1]] - half,
        }
        own: dict[str, Any] = {name: values[kept] for name, values in fields.items()}
        if follows:  # its statics are those of normal forces alone
            own["tangential_force"] = np.zeros((np.count_nonzero(kept), 3))
        return ContactNetwork(
            cell=cell,
            pbc=(p > 0, p > 1, p > 2),
            positions=positions,
            radii=radii,
            masses=masses,
            inertias=inertias,
            motions=crystal.motions or next(iter(allowed)),
            dimension=d,
            prestress=follows,
            adhesive=crystal._springs.adhere,
            contact_model=crystal.contact_model,
            kinds=(
                *(crystal.names[one] for one in crystal.kind.tolist()),
                *(RIGID_PLANE.name,) * extra,
            ),
            **own,
        )


def list_balls(balls: Any) -> list[Any]:
    """Return balls, the argument of a public call, as a list; one ball is a list of one."""
    listed = balls.tolist() if isinstance(balls, np.ndarray) else balls
    if isinstance(listed, str | Mapping | set | frozenset) or not isinstance(
        listed, Iterable | Ball
    ):
        raise InputError(f"the balls are {brief(balls)}", mend="Give a list of granphon.Ball")
    return [listed] if isinstance(listed, Ball) else list(listed)


def find_kinds(balls: Sequence[Any]) -> tuple[tuple[Ball, ...], Index]:
    """Return the different balls in the order in which they come, and the number of the kind of
    each.
    """
    if not balls:
        raise InputError("there are no balls", mend="Give a list of granphon.Ball")
    of_object: dict[int, int] = {}
    kinds: dict[Ball, int] = {}
    numbers = []
    for ball in balls:
        number = of_object.get(id(ball))
        if number is None:
            if not isinstance(ball, Ball):
                raise InputError(
                    f"{brief(ball)} is not a ball", mend="Give a granphon.Ball for each site"
                )
            number = of_object[id(ball)] = kinds.setdefault(ball, len(kinds))
        numbers.append(number)
    return tuple(kinds), np.array(numbers, np.intp)


def name_kinds(kinds: Sequence[Ball], known: Mapping[Ball, str] | None = None) -> tuple[str, ...]:
    """Return the name of each kind: that which is known or its own, or the next of the letters A,
    B, C, ...
    """
    names = {ball: (known or {}).get(ball) or ball.name for ball in kinds}
    used_names = {name for name in names.values() if name} | {RIGID_PLANE.name}
    letters = (
        map("".join, itertools.product(ascii_uppercase, repeat=size)) for size in itertools.count(1)
    )
    free = (letter for letter in itertools.chain.from_iterable(letters) if letter not in used_names)
    kind_names = tuple(names[ball] or next(free) for ball in kinds)
    if len(set(kind_names)) < len(kind_names) or RIGID_PLANE.name in kind_names:
        twice = next(
            name for name in kind_names if kind_names.count(name) > 1 or name == RIGID_PLANE.name
        )
        raise InputError(
            f"two kinds are called {twice!r}",
            "Laws are given by names",
            "Name each kind differently",
        )
    return kind_names


def _require_room(cells: int, crystal: Crystal) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for so many cells of a crystal that do not
    fit into memory.
    """
    balls = cells * crystal.n_balls
    memory = _BALL_BYTES * cells * (crystal.n_balls + crystal.n_contacts)
    require_memory(f"crystals of {balls:,} balls", memory, "Take fewer cells")
    if balls > _MOST_BALLS:
        raise InputError(
            f"the crystal would have {balls:,} balls", mend=f"Make it of up to {_MOST_BALLS:,}"
        )


@contextmanager
def _in_double_precision(values: Array) -> Iterator[None]:
    """Turn an overflow of the block into an error about the load ``values``."""
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except FloatingPointError:
        problem = f"a crystal under a load of {brief(values.tolist())} is beyond double precision"
        raise InputError(problem, mend="Lower the load, or compare the units") from None
