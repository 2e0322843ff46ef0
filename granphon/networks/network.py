"""A finite network of contacts: balls, and springs between those that touch, in SI units.

A network comes from a simulated sample, from ``ase.Atoms`` with a calculator, from a lattice, or
from a program of discrete elements. It need not have any order. Waves in it are found by
:class:`granphon.waves.waves.Waves`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.ball import Wall
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import overlap_from
from granphon.balls.lattices import Lattice
from granphon.balls.layers import Layers, find_axes, read_edges
from granphon.balls.material import Material
from granphon.balls.motions import Motions, allowed_motions, select_motions
from granphon.balls.neighbours import repeat_contacts
from granphon.balls.on_site import name_springs
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import (
    GranphonError,
    InputError,
    brief,
)
from granphon.base.memory import require_memory
from granphon.base.registry import Registry
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    index_array,
    is_one_of,
    label,
    lengths,
    one_of,
    real_array,
    require,
    spell_out,
    text_list,
    truth,
    whole_number,
)
from granphon.networks.consistency import BALANCE_LIMIT, REST_LIMIT, warn_of_faults
from granphon.networks.demands import NUMBERS_OF_BALLS, list_demands
from granphon.networks.sources import (
    LARGEST_NUMBER,
    SLIP_LEVERS,
    TANGENTIAL_LAWS,
    Completion,
    CompletionOptions,
    Reading,
    are_independent,
    find_repeated,
    read_whole_numbers,
)

if TYPE_CHECKING:
    from granphon.networks.building import Source

Found = TypeVar("Found")
#: fields of whole numbers
_WHOLE_NUMBER_FIELDS = ("i", "j", "shift", "labels")
#: memory that is taken to repeat or to cut a network, and to check the result, over the memory of
#: the arrays of the result
_COPIES = 4.5
#: the key under which a network keeps what its reader knows beside its numbers
_READING_KEY = "reading"
#: most cells along a period
MOST_CELLS = 1_000_000


@result_class
class ContactNetwork(Result):
    """Balls and the contacts between them; SI units.

    Attributes
    ----------
    cell : (3, 3) vectors of the periodic cell as rows, m; zero along axes without a period.
    pbc : (3,) whether the network repeats along each vector of the cell.
    positions : (n, 3) centres, m. Balls on a line lie along x, balls of a plane in the xy plane.
    radii : (n,) m.
    masses : (n,) kg. A mass of infinity is a body that does not move, such as a wall.
    inertias : (n,) moments of inertia about a diameter, kg m^2.
    i, j : (n_c,) indices of the two balls of each contact. A flat wall, whose radius is infinite,
        becomes ball j.
    shift : (n_c, 3) whole cells by which ball j is displaced.
    normal : (n_c, 3) unit vectors from i to j along which contacts are compressed.
    normal_force : (n_c,) compressive forces, N, zero or above; below zero where balls that adhere
        pull.
    normal_stiffness : (n_c,) N/m, above zero.
    shear_stiffness : (n_c,) N/m, zero where a contact does not resist slip.
    torsion_stiffness, bending_stiffness : (n_c,) resistance against twist and against rolling, N m.
    arm_i, arm_j : (n_c,) distances from the two centres to the contact, m.
    tangential_force : (n_c, 3) static forces across contacts, with which ball i acts on ball j, N;
        None if they are not known. With prestress they stay across the contacts as these turn, as
        in LAMMPS, and change with the overlap as the ``tangential_law`` says.
    motions : "longitudinal", "in_plane", "out_of_plane" or "all": the motions of each ball. Balls
        rotate only if some contact or spring to the ground resists it.
    contact_torque : (n_c, 3) static torques of rolling and twist, with which ball i acts on ball j,
        N m, beside those of tangential forces; None: not known, or none. With ``prestress`` they
        turn with their contacts.
    dimension : 1, 2 or 3 for balls on a line, in a plane, in space.
    prestress : whether static forces act on displacements across contacts, with the stiffness -f/r,
        where r is the distance of the centres.
    left_out : number of rattlers, balls that carry no load, that have been left out.
    labels : (n,) whole numbers that name the balls, such as those in the file from which they come;
        None if there are none.
    lattice, shape : the lattice and the numbers of cells (L1, ..., Lp) of an array whose balls come
        in the order of its cells, ball by ball of each cell; None for a network of another kind.
    adhesive : whether contacts may pull.
    kinds : (n,) names of the kinds of the balls, by which pictures and files tell them apart; None
        if they are not known.
    contact_model : the materials of the kinds and the law of their contacts, from which :meth:`cut`
        knows how balls stand on a floor; None if they are not known.
    on_site : (n, motions) stiffnesses of springs to the ground against each of the ``motions`` of a
        ball, displacements first, N/m, then rotations, N m; None without such springs.
    tangential_law : how a static tangential force T changes with the overlap delta while the slip
        stays, by the name of the law in a program. "mindlin/force": T keeps its size. "yade": T
        keeps its size, and turns about the normal by the mean of the rotations of the two balls.
        "mindlin" and "liggghts" (also ``gran/hertz/history``): the slip of the past is kept, and T
        grows as the shear stiffness, as delta^(1/2). "mindlin_rescale" and "mindlin_rescale/force":
        the same two, but slip or force shrinks where the overlap does; the response is the mean of
        both directions, as delta^(3/4) and delta^(1/4).
    slip_levers : the levers by which rotations of balls make slip. "arms": the distances ``arm_i``
        and ``arm_j``, which are also the levers of torques. "radii", as in ``pair_style granular``
        of LAMMPS: the radii, which exceed the arms by half of the overlap, but for flat walls of
        LAMMPS, at which the arm is the radius; with ``prestress`` slip then has no potential.
        "yade": the radii, and displacements across the contact count (R_i + R_j)/r times, with the
        radii R and the distance r of the centres, so that no slip is left of a rotation of both
        balls together; a flat wall counts as the mirror image of the ball, and the arm at it ends
        there. The excess is of the order of the terms of static forces: without ``prestress`` both
        are neglected, and the levers are the arms. Motions of any amplitude
        (:class:`~granphon.NonlinearWaves`) have the levers "arms" or "radii" alone.

    Raises
    ------
    InputError : no ball of a finite radius, arrays of different lengths, a contact that names a
        ball that is not there, joins a ball with itself or is listed twice, a shift along a vector
        that is no period or of more than 1e9 cells, a force that pulls unless contacts are
        ``adhesive``, a number that is not finite or out of range, a normal whose length is not one,
        a normal that does not lead from ball i to ball j where both move, balls that move and whose
        distance differs from the sum of the two arms by more than a quarter of that, a contact that
        leaves the line or the plane, a tangential force that is not across the normal, periods that
        are not independent or leave the line or the plane, motions that the dimension does not
        have, two balls with one label, a ``shape`` that does not fit the lattice or the number of
        balls, an ``on_site`` of another shape, below zero or not finite; and, for each field, a
        value of another kind than the one described.
    """

    _schema: ClassVar[int] = 2

    cell: Array = held(float, "3 3", "m")
    pbc: tuple[bool, bool, bool] = held((bool, bool, bool))
    positions: Array = held(float, "n 3", "m")
    radii: Array = held(float, "n", "m")
    masses: Array = held(float, "n", "kg")
    inertias: Array = held(float, "n", "kg m^2")
    i: Index = held(int, "c")
    j: Index = held(int, "c")
    shift: Index = held(int, "c 3")
    normal: Array = held(float, "c 3")
    normal_force: Array = held(float, "c", "N")
    normal_stiffness: Array = held(float, "c", "N/m")
    shear_stiffness: Array = held(float, "c", "N/m")
    torsion_stiffness: Array = held(float, "c", "N m")
    bending_stiffness: Array = held(float, "c", "N m")
    arm_i: Array = held(float, "c", "m")
    arm_j: Array = held(float, "c", "m")
    motions: str = held(str, default="all")
    dimension: int = held(int, default=3)
    prestress: bool = held(bool, default=False)
    left_out: int = held(int, default=0)
    labels: Index | None = held(int, "n?", default=None)
    lattice: Lattice | None = held(Lattice, "?", default=None)
    shape: tuple[int, ...] | None = held((int, ...), "?", default=None)
    tangential_force: Array | None = held(float, "c 3?", "N", default=None)
    contact_torque: Array | None = held(float, "c 3?", "N m", default=None)
    adhesive: bool = held(bool, default=False)
    kinds: tuple[str, ...] | None = held((str, ...), "n?", default=None)
    contact_model: ContactModel | None = held(ContactModel, "?", default=None, repr=False)
    on_site: Array | None = held(float, "n m?", within="zero or above", default=None)
    tangential_law: str = held(str, default="mindlin/force")
    slip_levers: str = held(str, default="arms")

    def __post_init__(self) -> None:
        """Check every field, and replace its value by the one that is kept: arrays become
        read-only, cell vectors that are no periods become zero, springs to the ground of zero
        become None, and flat walls become ball j of their contacts.
        """
        checked: dict[str, Any] = {
            "pbc": _read_periods(self.pbc),
            "prestress": require("prestress", truth, self.prestress),
            "adhesive": require("adhesive", truth, self.adhesive),
            "dimension": whole_number("dimension", self.dimension, 1, 3),
            "left_out": whole_number("left_out", self.left_out, 0),
            "tangential_law": one_of("tangential_law", self.tangential_law, TANGENTIAL_LAWS),
            "slip_levers": one_of("slip_levers", self.slip_levers, SLIP_LEVERS),
        }
        self._require_objects()
        if self.shape is not None:
            in_range = partial(lengths, low=1, high=MOST_CELLS)
            checked["shape"] = require("shape", in_range, self.shape)
        if self.kinds is not None:
            checked["kinds"] = require("kinds", text_list, self.kinds)
            for name in dict.fromkeys(checked["kinds"]):
                require("the name of a kind", label, name)
        checked |= self._read_arrays()
        if checked["cell"].shape == (3, 3):
            # a vector along which nothing repeats has no meaning
            is_period = np.array(checked["pbc"])[:, None]
            checked["cell"] = read_only(np.where(is_period, checked["cell"], 0.0))
        if not np.any(checked.get("on_site")):
            checked["on_site"] = None
        for name, values in checked.items():
            object.__setattr__(self, name, values)
        super().__post_init__()
        self._check()

    def _require_objects(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless ``lattice`` and ``contact_model``
        are of their classes, or None.
        """
        lattice: Any = self.lattice
        if not isinstance(lattice, Lattice | None):
            fault = f"the lattice of the network is {brief(lattice)}"
            raise InputError(fault, mend="Give a granphon.Lattice, or None")
        model: Any = self.contact_model
        if not isinstance(model, ContactModel | None):
            fault = f"the contact model of the network is {brief(model)}"
            raise InputError(fault, mend="Give a material where the network is read, or None")

    def _read_arrays(self) -> dict[str, Any]:
        """Return the fields of numbers, by name, as read-only arrays, without fields that may be
        None and are; :class:`~granphon.base.errors.InputError` for values that are no numbers, or
        no whole numbers where these are needed.
        """
        arrays: dict[str, Any] = {}
        for name, layout in self._shapes.items():
            values = getattr(self, name)
            is_left_out = values is None and layout.endswith("?")  # "?": the field may be None
            if name == "kinds" or is_left_out:  # kinds are words
                continue
            numbers = read_whole_numbers if name in _WHOLE_NUMBER_FIELDS else real_array
            arrays[name] = read_only(numbers(name, values))
        return arrays

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for fields that the class does not allow.

        When the shapes of the fields have been checked, contacts whose ball i is a flat wall are
        reversed, in place (:meth:`_reverse_wall_contacts`). Then the entries are judged.
        """
        super()._check()
        self._reverse_wall_contacts()
        self._check_motions()
        if np.all(np.isinf(self.radii)):  # flat walls alone, or nothing
            raise InputError("the network has no ball", mend="Give one or more, of a finite radius")
        self._check_cell()
        for name, is_fine, fault, mend in list_demands(self):
            if not np.all(is_fine):
                self._refuse(name, ~np.asarray(is_fine), fault, mend)
        if self.n_contacts:
            self._check_repeated()
        if self.labels is not None and np.unique(self.labels).size != self.n_balls:
            fault = "two balls of the network have the same label"
            raise InputError(fault, mend="Give each a label of its own")
        self._check_lattice()

    def _check_motions(self) -> None:
        """Raise InputError for motions that balls in this dimension do not have, and for springs to
        the ground that are not one for each motion.
        """
        motions = allowed_motions(self.dimension)
        if not is_one_of(self.motions, motions):
            fault = f"a network in {self.dimension} dimensions has no motions {brief(self.motions)}"
            raise InputError(fault, mend="Use " + ", ".join(motions))
        if self.on_site is not None and self.on_site.shape[1] != motions[self.motions].count:
            names = ", ".join(name_springs(motions[self.motions]))
            fault = f"on_site of the network has the shape {self.on_site.shape}"
            raise InputError(fault, mend=f"Give a stiffness for each motion of a ball: {names}")

    def _check_lattice(self) -> None:
        """Raise InputError unless an array of a lattice has a length along each period of the
        lattice, and the balls of all of its cells.
        """
        if self.lattice is None or self.shape is None:
            return
        n_balls = self.lattice.n_balls * int(np.prod(self.shape, dtype=float))
        if len(self.shape) != self.lattice.periods or n_balls != self.n_balls:
            raise InputError(
                f"{self.shape} cells of the {self.lattice.name} lattice, which has"
                f" {counted(self.lattice.periods, 'period')}, have {n_balls} balls, and the network"
                f" has {self.n_balls}",
                mend="Mend the shape",
            )

    def _refuse(self, name: str, is_bad: Flags, fault: str, mend: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` that names the first bad entry of the
        field ``name`` and says how many entries are bad; ``is_bad`` has a flag for each ball, (n,),
        or for each contact, (n_c,), whichever the entries of the field belong to.
        """
        bad_indices = np.flatnonzero(is_bad)
        index = bad_indices[0]
        subject = "ball" if self._shapes[name].startswith("n") else "contact"
        entry = np.asarray(getattr(self, name))[index]
        shown = f"{name} = {np.array2string(entry)}"
        if subject == "contact" and name not in ("i", "j"):
            shown += f", between balls {self.i[index]} and {self.j[index]}"
        total = f" ({bad_indices.size} in all)" if bad_indices.size > 1 else ""
        raise InputError(f"{subject} {index} of the network {fault}: {shown}{total}", mend=mend)

    def _reverse_wall_contacts(self) -> None:
        """Let each contact with a flat wall lead from the ball to the wall: where ball i is the
        wall, exchange the two ends, and reverse shift, normal, tangential force and torque, in
        place.
        """
        walls = np.flatnonzero(np.isinf(self.radii))
        is_reversed = np.isin(self.i, walls) & ~np.isin(self.j, walls)
        if not np.any(is_reversed):
            return
        fields = vars(self)
        for name_i, name_j in (("i", "j"), ("arm_i", "arm_j")):
            ends = np.stack([fields[name_i], fields[name_j]])
            exchanged_ends = np.where(is_reversed, ends[::-1], ends)
            fields[name_i] = read_only(exchanged_ends[0])
            fields[name_j] = read_only(exchanged_ends[1])
        for name in {"shift", "normal", "tangential_force", "contact_torque"} & {
            *self.contact_fields
        }:
            opposite = 0 - fields[name]  # 0 - x, as -x would make zeros of negative sign
            fields[name] = read_only(np.where(is_reversed[:, None], opposite, fields[name]))

    def _check_cell(self) -> None:
        """Raise InputError unless periodic vectors of the cell have greatest components between
        1/``LARGEST_NUMBER`` and ``LARGEST_NUMBER``, m, lie in the line or plane of the balls, and
        are independent.
        """
        for axis in np.flatnonzero(self.pbc):
            vector = self.cell[axis]
            size = np.max(np.abs(vector))
            if not 1.0 / LARGEST_NUMBER < size < LARGEST_NUMBER:  # also if the size is nan
                fault = f"vector {axis} of the cell is {vector.tolist()} m, and periodic"
                mend = "Give a vector of finite length, or let pbc be false there"
                raise InputError(fault, mend=mend)
            if axis >= self.dimension or np.any(vector[self.dimension :]):
                where = "the line" if self.dimension == 1 else "the plane"
                raise InputError(
                    f"vector {axis} of the cell, {vector.tolist()} m, leaves {where} of a network"
                    f" in {self.dimension} dimensions, and is periodic",
                    mend="Let it lie there, or let pbc be false",
                )
        if not are_independent(self.cell[list(self.pbc)]):
            fault = "the periodic vectors of the cell are not independent of each other"
            raise InputError(fault, mend="Give other vectors, or let pbc be false")

    def _check_repeated(self) -> None:
        """Raise InputError if a contact is listed twice, from one end or from both; a wall may
        touch a ball at several places.
        """
        i = self.i
        j = self.j
        both_move = self.moving[i] & self.moving[j]
        contacts, twins = find_repeated(i, j, self.shift, self.normal, both_move)
        n_repeated = contacts.size
        if not n_repeated:
            return
        contact = int(contacts[0])
        twin = int(twins[0])
        total = f" ({n_repeated} such in all)" if n_repeated > 1 else ""
        raise InputError(
            f"contacts {contact} and {twin} of the network are the same, between balls"
            f" {i[contact]} and {j[contact]}{total}",
            "Every contact counts once",
            "List each contact from one of its ends only",
        )

    # -- quantities --------------------------------------------------------------------------------

    @property
    def n_balls(self) -> int:
        """Number of balls."""
        return len(self.positions)

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return len(self.i)

    @cached_property
    def moving(self) -> Flags:
        """(n,) whether each ball moves: its mass is not infinite."""
        flags: Flags = read_only(np.isfinite(self.masses))
        return flags

    @cached_property
    def in_lattice(self) -> Flags:
        """(n_c,) whether a ball of each contact moves: contacts of two bodies that do not move are
        not in the lattice of the network.
        """
        flags: Flags = read_only(self.moving[self.i] | self.moving[self.j])
        return flags

    @cached_property
    def ball_motions(self) -> Motions:
        """The motions of each ball, without rotations if no contact and no spring to the ground
        resists them.
        """
        return select_motions(
            self.shear_stiffness,
            self.torsion_stiffness,
            self.bending_stiffness,
            self.named_motions,
            self.on_site,
        )

    @property
    def named_motions(self) -> Motions:
        """The motions of a ball that :attr:`motions` names."""
        return allowed_motions(self.dimension)[self.motions]

    @cached_property
    def is_anchored(self) -> Flags:
        """(n,) whether springs to the ground resist every displacement of each ball."""
        if self.on_site is None:
            return read_only(np.zeros(self.n_balls, bool))
        springs = self.on_site[:, self.named_motions.translating]
        return read_only(np.all(springs > 0.0, axis=1))

    @cached_property
    def vector(self) -> Array:
        """(n_c, 3) vectors from the centre of ball i to the centre of ball j, displaced by its
        ``shift``, m.
        """
        return read_only(self.positions[self.j] + self.shift @ self.cell - self.positions[self.i])

    @cached_property
    def distance(self) -> Array:
        """(n_c,) distance of the centres, m; infinite at a flat wall, which is a body of infinite
        radius at any place.
        """
        sizes = np.linalg.norm(self.vector, axis=1)
        return read_only(np.where(np.isinf(self.radii[self.j]), np.inf, sizes))

    @cached_property
    def static_forces(self) -> tuple[Array, Array]:
        """Forces of the contacts at rest, with which ball i acts on ball j, N: (n_c,) along
        normals, (n_c, 3) across them.

        The component of a tangential force along the normal, as of contacts that have turned since
        a program found the force, is added to the normal force.
        """
        if self.tangential_force is None:
            return self.normal_force, read_only(np.zeros((self.n_contacts, 3)))
        along = np.einsum("ca,ca->c", self.tangential_force, self.normal)
        across = self.tangential_force - along[:, None] * self.normal
        return read_only(self.normal_force + along), read_only(across)

    @cached_property
    def tangential_growth(self) -> Array:
        """(n_c,) relative growth of a static tangential force T with the overlap delta,
        (dT/d delta)/T, 1/m; zero at contacts that no normal force presses, and where the overlap is
        1e-60 m or less.

        By the ``tangential_law`` T goes as a power p of the overlap, so that the growth is p/delta.
        The overlap is that of Hertz's law, 3 f/(2 k), by the normal force f and stiffness k.
        """
        power = TANGENTIAL_LAWS[self.tangential_law].power
        overlap = overlap_from(self.normal_force, self.normal_stiffness)
        is_pressed = overlap > 1.0 / LARGEST_NUMBER  # p over a smaller overlap might overflow
        growth = np.divide(power, overlap, out=np.zeros(self.n_contacts), where=is_pressed)
        return read_only(growth)

    @cached_property
    def lever_excesses(self) -> tuple[Array, Array] | None:
        """The levers of slip less the arms, m: at balls i, (n_c,), and at balls j, (n_c,).

        The excess is zero at the end at a flat wall, and of contacts that do not resist slip. None
        if no lever differs from its arm, or if static forces do not act on displacements
        (``prestress``).
        """
        if not self.prestress or self.slip_levers == "arms":
            return None
        resists_slip = self.shear_stiffness > 0.0
        excesses = []
        for ball, arm in ((self.i, self.arm_i), (self.j, self.arm_j)):
            radii = self.radii[ball]
            has_lever = np.isfinite(radii) & resists_slip
            excesses.append(read_only(np.where(has_lever, radii, arm) - arm))
        at_i, at_j = excesses
        return (at_i, at_j) if np.any(at_i) or np.any(at_j) else None

    @cached_property
    def slip_stretch(self) -> Array:
        """(n_c,) the slip that a displacement across a contact makes, over the displacement, less
        one: (R_i + R_j)/(arm_i + arm_j) - 1 by the ``slip_levers`` of YADE, and
        2 R_i/(R_i + arm_i) - 1 at flat walls. It is zero by other levers, of contacts that do not
        resist slip or join two flat walls, and if static forces do not act on displacements
        (``prestress``).
        """
        stretch = np.zeros(self.n_contacts)
        if self.prestress and self.slip_levers == "yade":
            radii_i = self.radii[self.i]
            radii_j = self.radii[self.j]
            is_ball = np.isfinite(radii_j)
            surfaces = radii_i + np.where(is_ball, radii_j, radii_i)
            arms = self.arm_i + np.where(is_ball, self.arm_j, radii_i)
            can_slip = (self.shear_stiffness > 0.0) & np.isfinite(radii_i)
            stretch[can_slip] = surfaces[can_slip] / arms[can_slip] - 1.0
        return read_only(stretch)

    @cached_property
    def arm_rates(self) -> Array:
        """(n_c,) growth of either arm with the elongation of a contact, over the elongation: 1/2,
        as arms end amid the overlap. At a flat wall the growth is zero of an arm that is the
        radius, as in LAMMPS, and one by the ``slip_levers`` of YADE, by which the arm ends at the
        wall.
        """
        rates_at_walls = np.where(self.arm_i == self.radii[self.i], 0.0, 0.5)
        if self.slip_levers == "yade":
            rates_at_walls = np.ones(self.n_contacts)
        return read_only(np.where(np.isinf(self.radii[self.j]), rates_at_walls, 0.5))

    @property
    def turns_with_balls(self) -> bool:
        """Whether static tangential forces turn about the normals with the balls, by the
        ``tangential_law``.
        """
        return TANGENTIAL_LAWS[self.tangential_law].turns

    @cached_property
    def unbalanced(self) -> tuple[Array, Array]:
        """Sums of the static forces, N, and of their torques, N m, on each ball, both (n, 3); zero
        for balls that do not move.
        """
        normal_force, tangential_force = self.static_forces
        # (n_c, 3) forces of balls i on balls j
        contact_forces = normal_force[:, None] * self.normal + tangential_force
        forces = np.zeros((self.n_balls, 3))
        torques = np.zeros((self.n_balls, 3))
        # ball j gets the force of ball i, and ball i the opposite one
        for balls, sign, arms in ((self.j, 1.0, self.arm_j), (self.i, -1.0, self.arm_i)):
            np.add.at(forces, balls, sign * contact_forces)
            np.add.at(torques, balls, -arms[:, None] * np.cross(self.normal, tangential_force))
            if self.contact_torque is not None:
                np.add.at(torques, balls, sign * self.contact_torque)
        forces[~self.moving] = 0.0
        torques[~self.moving] = 0.0
        return read_only(forces), read_only(torques)

    @cached_property
    def imbalance(self) -> tuple[int, float, float]:
        """The ball that is farthest from balance, the size of the sum of the static forces on it,
        N, and that size over the mean force of a contact; see :meth:`find_farthest`.
        """
        return self.find_farthest(self.unbalanced[0])

    @cached_property
    def mean_force(self) -> float:
        """Mean size of the static forces of contacts, N; zero without contacts."""
        if not self.n_contacts:
            return 0.0
        normal_force, tangential_force = self.static_forces
        tangential_sizes = np.linalg.norm(tangential_force, axis=1)
        return float(np.mean(np.hypot(normal_force, tangential_sizes)))

    @cached_property
    def residual_forces(self) -> Array:
        """(n, 3) sums of the static forces on each ball, N, less the part that may be in balance
        with gravity; zero for balls that do not move.

        Where some balls do not move, the others may be held against gravity, whose direction and
        size the network does not know. The uniform acceleration that leaves the least sum of
        squares of the forces is then subtracted, times the mass of each ball. Where all balls move,
        nothing is subtracted.
        """
        forces, _torques = self.unbalanced
        if np.all(self.moving) or not np.any(self.moving):
            return forces
        masses = np.where(self.moving, self.masses, 0.0)
        acceleration = masses @ forces / (masses @ masses)
        return read_only(forces - masses[:, None] * acceleration)

    def find_farthest(self, forces: Array) -> tuple[int, float, float]:
        """Return the ball under the largest of the ``forces`` (n, 3), N, the size of that force, N,
        and the size over the mean force of a contact: zero if all ``forces`` are zero, else
        infinite if the mean force is zero.

        Raises :class:`~granphon.base.errors.InputError` for forces of another shape, and for
        components that are not below 1e120 N.
        """
        forces = real_array("forces", forces)
        if forces.shape != (self.n_balls, 3):
            fault = f"the forces have the shape {forces.shape}"
            raise InputError(fault, mend=f"Give one for each ball: ({self.n_balls}, 3)")
        if not np.all(np.abs(forces) < LARGEST_NUMBER**2):  # squares of larger ones might overflow
            raise InputError("the forces are not finite, or too large", mend="Give others, in N")
        sizes = np.linalg.norm(forces, axis=1)
        ball = int(np.argmax(sizes))
        size = float(sizes[ball])
        if not size:  # the mean force may be zero, too
            return ball, 0.0, 0.0
        ratio = size / self.mean_force if self.mean_force else math.inf
        return ball, size, ratio

    def name_ball(self, ball: int) -> int:
        """Return the label of a ball, given by its index, or the index where balls have no labels;
        :class:`~granphon.base.errors.InputError` for a ball that is not there.
        """
        index = whole_number("ball", ball, 0, self.n_balls - 1)
        return index if self.labels is None else int(self.labels[index])

    def describe_imbalance(self, imbalance: tuple[int, float, float] | None = None) -> str:
        """Return in words which ball is farthest from balance, and by what force; empty if all
        forces are zero. ``imbalance`` is what :meth:`find_farthest` returns of some forces, by
        default :attr:`imbalance`, that of the static forces.
        """
        ball, force, ratio = self.imbalance if imbalance is None else imbalance
        if not force:
            return ""
        return (
            f"The static forces on ball {self.name_ball(ball)} add up to {force:.3g} N,"
            f" {ratio:.2g} of the mean contact force"
        )

    @property
    def is_balanced(self) -> bool:
        """Whether the static forces on each ball add up to no more than 1e-3 of the mean force of a
        contact.

        Also true where nothing can be judged: without ``prestress`` or contacts, and with springs
        to the ground, whose static forces the network does not have.
        """
        can_be_judged = self.prestress and self.on_site is None and self.n_contacts > 0
        if not can_be_judged:
            return True
        _ball, _force, ratio = self.imbalance
        return ratio <= BALANCE_LIMIT

    def require_rest(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if static forces act, and some ball is so
        far from balance that the balls still move: the :attr:`residual_forces` on the ball are
        5e-3 of the mean force of a contact or more.

        A network with springs to the ground is not judged, and neither is one without a period
        along some axis: walls that are not in a file may hold its balls there.
        """
        if self.is_balanced or not all(self.pbc[: self.dimension]):
            return
        farthest = self.find_farthest(self.residual_forces)
        _ball, _force, ratio = farthest
        if ratio < REST_LIMIT:
            return
        weight = "" if np.all(self.moving) else ", less what gravity may balance"
        raise InputError(
            "the balls of the network still move, and static forces act on them (prestress)",
            f"{self.describe_imbalance(farthest)}{weight}",
            "Bring it to rest, to 1e-4 of the mean force, give its tangential_force if it has"
            " friction, or leave the static forces out (prestress=False)",
        )

    @property
    def contact_places(self) -> Array:
        """(n_c, 3) places of the contacts, m: the centre of ball i plus its arm along the
        normal.
        """
        return np.asarray(self.positions[self.i] + self.arm_i[:, None] * self.normal)

    @cached_property
    def walls(self) -> dict[int, tuple[Array, Array]]:
        """By its index, each flat wall that balls touch: a point on the wall, (3,), m, and the
        normal of the wall, (3,), away from the balls.
        """
        points = read_only(self.contact_places)
        walls: dict[int, tuple[Array, Array]] = {}
        # the contacts are taken from the last to the first: of several contacts of a wall the first
        # one replaces the others
        is_at_wall = np.isinf(self.distance) & np.isfinite(self.radii[self.i])
        for contact in np.flatnonzero(is_at_wall)[::-1].tolist():
            walls[int(self.j[contact])] = (points[contact], self.normal[contact])
        return walls

    def cached(self, find: Callable[[Self], Found]) -> Found:
        """Return ``find(self)``; the value of the first call is kept, as the network never
        changes.
        """
        if find not in self._cache:
            self._cache[find] = find(self)
        value: Found = self._cache[find]
        return value

    @cached_property
    def _cache(self) -> dict[Any, Any]:
        """What has been found of this network, by the functions that have found it
        (:meth:`cached`), and its :attr:`reading`. A changed copy begins with an empty one.
        """
        return {}

    @cached_property
    def scales(self) -> Units:
        """Length, stiffness and mass of the reduced units of this network.

        They are the mean diameter and the mean mass of the balls that move, and the mean normal
        stiffness of the contacts that a force presses, or of all contacts if there are none. Raises
        :class:`~granphon.base.errors.InputError` for a network without a ball that moves, or
        without a contact.
        """
        if not np.any(self.moving) or not self.n_contacts:
            why = "It has no ball that moves, or no contact"
            raise InputError("the network has no reduced units", why)
        is_pressed = self.normal_force > 0.0
        if not np.any(is_pressed):
            is_pressed = np.ones(self.n_contacts, bool)
        diameter = _find_mean(2.0 * self.radii[self.moving])
        stiffness = _find_mean(self.normal_stiffness[is_pressed])
        return Units(diameter, stiffness, _find_mean(self.masses[self.moving]))

    @property
    def coordination(self) -> float:
        """Mean number of contacts of a ball that moves; zero if none moves."""
        n_moving = int(np.count_nonzero(self.moving))
        n_ends = np.count_nonzero(self.moving[self.i]) + np.count_nonzero(self.moving[self.j])
        return float(n_ends / max(n_moving, 1))

    @property
    def fabric(self) -> Array:
        """(d, d) fabric tensor: the mean of n n over the contacts, n being their normals, in d
        dimensions. Its trace is 1; contacts that have no preferred direction have 1/d on the
        diagonal.

        In a plane the contacts have the angular density (1 + a cos 2(theta - theta_0))/2 pi, to
        second order, where a is twice the difference of the two eigenvalues, and theta_0 the
        direction of the larger one. InputError for a network without contacts.
        """
        return self._average_directions(np.ones(self.n_contacts))

    @property
    def force_fabric(self) -> Array:
        """(d, d) the mean of f n n over the contacts, over the mean of f, with the normal forces f:
        the :attr:`fabric` in which a contact counts as its force. InputError if the forces add up
        to zero, as without contacts.
        """
        return self._average_directions(self.normal_force)

    def _average_directions(self, weights: Array) -> Array:
        """Return the mean (d, d) of n n over the contacts, n being their normals, with ``weights``
        (n_c,); InputError if the weights add up to zero.
        """
        total = float(np.sum(weights))
        if not total:
            raise InputError("the network has no contacts, or their normal forces add up to zero")
        normal = self.normal[:, : self.dimension]
        return np.asarray(np.einsum("c,ca,cb->ab", weights, normal, normal) / total)

    @property
    def contact_fields(self) -> tuple[str, ...]:
        """Names of the fields that have one entry for each contact, without those that are None."""
        names = [name for name, layout in self._shapes.items() if layout[0] == "c"]
        return tuple(name for name in names if getattr(self, name) is not None)

    # -- parts of the network ----------------------------------------------------------------------

    @cached_property
    def rattlers(self) -> Index:
        """Indices of the balls that carry no load: balls with too few contacts to be held, then
        balls that have too few contacts without them, and so on.

        A contact counts if its force is above 8e-9 of the mean of those above zero. Under less, a
        contact of Hertz's law, whose stiffness goes as the third root of its force, is less than
        2e-3 as stiff as under the mean. If no contact of the network has a force, all contacts
        count, as if their forces were equal; and in an ``adhesive`` network all count, as they are
        stiff without a force, too. :meth:`without_rattlers` says how many contacts hold a ball. A
        body that does not move is no rattler, and neither is a ball whose displacements are all
        resisted by springs to the ground.
        """
        from granphon.networks.rattlers import find_rattlers

        return read_only(find_rattlers(self))

    def without_rattlers(self, held_by: int | None = None) -> Self:
        """Return the network without the balls that carry no load, whose number is added to
        ``left_out``; a network without such balls is returned itself.

        ``held_by`` is the least number of contacts that hold a ball. The default is two if contacts
        resist slip, else one more than there are dimensions; without slip resistance two or more
        contacts whose forces are in balance, as along a straight row, also hold a ball. Where
        gravity holds balls down, fewer contacts hold them: give ``held_by`` then. Raises
        :class:`~granphon.base.errors.InputError` if all balls that move are rattlers, and for a
        ``held_by`` that is no whole number of zero or more.
        """
        from granphon.networks.rattlers import find_most_held_by, find_rattlers

        n_holding = None if held_by is None else whole_number("held_by", held_by, 0)
        rattlers = self.rattlers if n_holding is None else find_rattlers(self, n_holding)
        if not rattlers.size:
            return self
        is_kept = np.ones(self.n_balls, bool)
        is_kept[rattlers] = False
        if not np.any(is_kept & self.moving):
            fault = "all balls of the network are rattlers, which carry no load"
            why = "Each has fewer contacts than can hold it, or is left so by others"
            mend = ""
            # less than the number that has left no ball; the default one is not above this
            n_most = self.dimension + 1 if n_holding is None else n_holding - 1
            holding = find_most_held_by(self, n_most)
            if holding:
                mend = f"If something else holds them too, give held_by={holding}"
            raise InputError(fault, why, mend)
        return replace(self.select(is_kept), left_out=self.left_out + int(rattlers.size))

    def select(self, balls: ArrayLike) -> Self:
        """Return the network of some balls, given by their indices or as (n,) truth values, and of
        the contacts among them. Balls come in the order of the indices.

        The network keeps the ``labels`` of the balls; without labels they are the indices in this
        network. It has neither ``lattice`` nor ``shape``. Its ``contact_model`` has no wall if no
        flat wall is kept, and else, where balls have ``kinds``, only the walls that are kept.

        Raises :class:`~granphon.base.errors.InputError` for what is no index of a ball, for a ball
        given twice, for no ball of a finite radius, and for another number of truth values.
        """
        kept_balls = self._read_selection(balls)
        new_index = np.full(self.n_balls, -1)  # -1 for balls that are left out
        new_index[kept_balls] = np.arange(kept_balls.size)
        i = new_index[self.i]
        j = new_index[self.j]
        is_kept = (i >= 0) & (j >= 0)
        labels = np.arange(self.n_balls) if self.labels is None else self.labels
        fields: dict[str, Any] = {}
        for name in ("positions", *NUMBERS_OF_BALLS):
            fields[name] = getattr(self, name)[kept_balls]
        for name in self.contact_fields:
            fields[name] = getattr(self, name)[is_kept]
        fields |= {
            "i": i[is_kept],
            "j": j[is_kept],
            "labels": labels[kept_balls],
            "lattice": None,
            "shape": None,
        }
        if self.kinds is not None:
            fields["kinds"] = tuple(self.kinds[ball] for ball in kept_balls.tolist())
        if self.on_site is not None:
            fields["on_site"] = self.on_site[kept_balls]
        if self.contact_model is not None:
            walls = self._select_walls(self.contact_model, kept_balls)
            fields["contact_model"] = replace(self.contact_model, walls=walls)
        return replace(self, **fields)

    def _read_selection(self, balls: ArrayLike) -> Index:
        """Return the indices (m,) of some ``balls``, which are given by their indices or as (n,)
        truth values; errors are those of :meth:`select`.
        """
        # a list of truth values says which balls are kept; any other list has indices
        plain: Any = balls.tolist() if isinstance(balls, np.ndarray) else balls
        is_list = isinstance(plain, list | tuple) and len(plain) > 0
        are_flags = is_list and all(isinstance(value, bool | np.bool_) for value in plain)
        if are_flags and len(plain) != self.n_balls:
            fault = f"balls are {len(plain)} truth values, and the network has {self.n_balls} balls"
            raise InputError(fault, mend="Give one for each ball, or the indices of balls")
        indices = np.flatnonzero(plain) if are_flags else balls
        return index_array("balls", indices, self.n_balls)

    def _select_walls(self, model: ContactModel, kept_balls: Index) -> tuple[Wall, ...]:
        """Return those of the elastic walls of a contact ``model`` that are among ``kept_balls``,
        (m,) indices: the names of kinds tell which they are, and without kinds all are returned if
        any flat wall is kept.
        """
        kept_walls = kept_balls[np.isinf(self.radii[kept_balls])].tolist()
        if self.kinds is None:
            return model.walls if kept_walls else ()
        names = {self.kinds[ball] for ball in kept_walls}
        return tuple(wall for wall in model.walls if wall.name in names)

    @cached_property
    def piece_numbers(self) -> Index:
        """(n,) number of the piece of each ball, see :func:`number_pieces`."""
        return read_only(number_pieces(self.i, self.j, self.moving))

    def pieces(self) -> tuple[Self, ...]:
        """Return the pieces of the network, sets of balls that contacts join, as networks, the
        largest first; (self,) if there is one piece alone.

        A body that does not move, as a wall, joins no pieces; each piece that touches the body
        contains it. A body that no ball touches is in no piece, unless there is one piece alone,
        which is the network itself. There is no piece where no ball moves.
        """
        moving = self.moving
        piece_of_ball = self.piece_numbers
        # the balls that move, in the order of their pieces, split between these
        members = np.flatnonzero(moving)
        members = members[np.argsort(piece_of_ball[members], kind="stable")]
        bounds = np.flatnonzero(np.diff(piece_of_ball[members])) + 1
        pieces = np.split(members, bounds) if members.size else []
        is_at_wall = ~(moving[self.i] & moving[self.j])
        if np.any(is_at_wall):
            # the two ends of each contact with a body that does not move, here called a wall
            touching_balls = np.where(moving[self.i], self.i, self.j)[is_at_wall]
            touched_walls = np.where(moving[self.i], self.j, self.i)[is_at_wall]
            for index, balls in enumerate(pieces):
                touches = piece_of_ball[touching_balls] == piece_of_ball[balls[0]]
                pieces[index] = np.unique(np.append(balls, touched_walls[touches]))
        if len(pieces) == 1:
            return (self,)
        return tuple(self.select(balls) for balls in sorted(pieces, key=len, reverse=True))

    # -- larger networks, cuts, files --------------------------------------------------------------

    def repeat(self, shape: tuple[int, ...]) -> Self:
        """Return the network of ``shape`` (L1, ..., Lp) cells, each a copy of this network; L is
        the number of cells along each period.

        Balls come in the order of cells, ball by ball of each cell, with the last period fastest.
        They have no labels, and ``left_out`` counts the balls that are left out of all cells. If
        this network is one cell of a lattice, and repeats along all of the periods of the lattice,
        the ``lattice`` is kept, and the field ``shape`` is the given one. Otherwise both are None.

        Raises :class:`~granphon.base.errors.InputError` for a network without periods, another
        number of lengths, lengths that are no whole numbers from 1 to 1,000,000, and more balls
        than memory holds.
        """
        axes = [axis for axis in range(3) if self.pbc[axis]]
        if not axes:
            fault = "this network has no period along which it could be repeated"
            raise InputError(fault, mend="Give its cell and pbc")
        shape = require("shape", partial(lengths, low=1, high=MOST_CELLS, periods=len(axes)), shape)
        self._require_memory(math.prod(shape))
        counts = np.ones(3, int)  # cells along all three vectors
        counts[axes] = shape
        cells, i, j, shift = repeat_contacts(
            self.i, self.j, self.shift, self.n_balls, tuple(counts.tolist())
        )
        origins = np.asarray(cells @ self.cell)  # (n_cells, 3), m
        n_cells = len(cells)
        balls: dict[str, Any] = {
            name: np.tile(getattr(self, name), n_cells) for name in NUMBERS_OF_BALLS
        }
        contacts: dict[str, Any] = {}
        for name in self.contact_fields:
            values = getattr(self, name)
            repetitions = (n_cells,) if values.ndim == 1 else (n_cells, 1)
            contacts[name] = np.tile(values, repetitions)
        contacts |= {"i": i, "j": j, "shift": shift}
        # copies of an array of several cells are not in the order of cells that a shape means, and
        # a shape has a length along each period: only copies of a single cell, along all periods,
        # keep lattice and shape
        has_one_cell = max(self.shape or (1,)) == 1
        is_cell = self.lattice is not None and has_one_cell and len(axes) == self.lattice.periods
        return replace(
            self,
            cell=self.cell * counts[:, None],
            positions=(origins[:, None] + self.positions).reshape(-1, 3),
            **balls,
            left_out=self.left_out * n_cells,
            labels=None,
            kinds=self.kinds and self.kinds * n_cells,
            on_site=None if self.on_site is None else np.tile(self.on_site, (n_cells, 1)),
            **contacts,
            lattice=self.lattice if is_cell else None,
            shape=shape if is_cell else None,
        )

    def _require_memory(self, n_cells: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``n_cells`` cells of this network do
        not fit into memory.
        """
        arrays = [getattr(self, name) for name in self._shapes]
        n_bytes = sum(values.nbytes for values in arrays if isinstance(values, np.ndarray))
        require_memory(
            f"networks of {n_cells * self.n_balls:,} balls",
            _COPIES * n_cells * n_bytes,
            "Take fewer cells",
        )

    def layers_across(self, axis: Any) -> Layers:
        """Return the vectors of the layers of the network across an ``axis``, which is given as for
        :meth:`cut`.

        Raises :class:`~granphon.base.errors.InputError` for an axis that is no period.
        """
        periods = self.cell[np.flatnonzero(self.pbc), : self.dimension]  # (p, d), m
        # layers are found along axes (d, d) of which the first ones span the periods
        axes = find_axes(periods) if len(periods) else np.eye(self.dimension)
        layers = Layers.across(axis, periods @ axes.T)
        return replace(layers, turn=layers.turn @ axes)

    def cut(self, axis: Any, layers: int, edges: Any = "free") -> Self:
        """Return a cut of the network: a number of its layers, one above the other, between two
        faces, across which nothing repeats; a strip, slab, column or flake.

        Contacts between balls keep the stiffness of the bulk: a cut says what waves do at an edge,
        and not how the balls of the edge would come to rest.

        Parameters
        ----------
        axis : the number, among the periods, of the vector along which layers follow each other; or
            the integer Miller indices of their plane, one for each period.
        layers : their number, in cells.
        edges : how the two faces are held, one word for both or (lower, upper). "free": nothing
            holds them. "clamped": the balls of the outer layer do not move. "floor": the outer
            balls touch a rigid plane. A :class:`~granphon.Wall`: they touch an elastic plane. Each
            ball presses on the plane with the force of the contacts that the ball has lost there,
            along the plane too if the network has tangential forces. The contact has the stiffness
            of a ball on such a plane under this force, by the :attr:`contact_model`, as a contact
            with the floor of :meth:`Crystal.cut <granphon.Crystal.cut>` has.

        The layers follow each other along the first axis that is no longer a period, the lower face
        first: along y for a cut of a plane, along z for a cut of space, and along x for a cut of a
        chain. If need be the network is turned, so that the periods that are left lie along x or in
        the xy plane.

        Raises :class:`~granphon.base.errors.InputError` for an axis that is no period, for
        ``layers`` that are no whole number from 1 to 1,000,000 or do not fit into memory, for other
        ``edges``, for so few layers that a contact reaches across all of them, if layers are not
        connected, if no ball can move, and if the balls of a clamped layer touch none that moves. A
        floor raises the error, too, if the materials of the balls are not known, if a ball is not
        pressed on it, or if a ball of the face has lost no contact. Where balls of one kind differ
        in size, a ball that has lost no contact stands on no floor instead, and the error is raised
        if all balls of the face are such.
        """
        from granphon.networks.cuts import cut_network

        n_layers = whole_number("layers", layers, 1, MOST_CELLS)
        faces = require("edges", read_edges, edges)
        self._require_memory(n_layers)
        return replace(self, **cut_network(self, self.layers_across(axis), n_layers, faces))

    @property
    def wall(self) -> Wall:
        """The wall of the network; InputError unless it has one wall whose material is known."""
        walls = () if self.contact_model is None else self.contact_model.walls
        if len(walls) != 1:
            fault = f"the network has {counted(len(walls), 'wall')} of a known material"
            raise InputError(fault, mend="Cut it with one: edges=(gp.Wall(steel), 'free')")
        return walls[0]

    def with_wall(self, material: Material) -> Self:
        """Return the network whose :attr:`wall` is of another ``material``. Contacts with the wall
        keep their forces, and get the stiffnesses that belong to the new material.

        Raises :class:`~granphon.base.errors.InputError` unless the network has one wall whose
        material is known, for what is no material, for a ball at the wall of an unknown material,
        and for a network without ``kinds`` that also has contacts with other flat walls: which
        contacts are those of the wall is not known there.
        """
        from granphon.networks.cuts import change_wall

        return replace(self, **change_wall(self, replace(self.wall, material=material)))

    def storable(self) -> Self:
        """Return the network as plain data and files can hold it: without the contact model of a
        user's own law.
        """
        model = self.contact_model
        return self if model is None or model.is_plain else replace(self, contact_model=None)

    def to_dict(self) -> dict[str, Any]:
        """Return the network as plain data, as of any result; without the contact model of a user's
        own law.
        """
        network = self.storable()
        return Result.to_dict(network)

    @classmethod
    @spell_out(Completion)
    def from_table(
        cls,
        balls: Any,
        contacts: Any,
        *,
        material: Material | None = None,
        cell: ArrayLike | None = None,
        pbc: Sequence[bool] | None = None,
        columns: Mapping[str, str] | None = None,
        **options: Unpack[CompletionOptions],
    ) -> Self:
        """Return the network that a table of balls and one of contacts describe.

        Each table is the path of a CSV file whose headings have units, such as ``radius (mm)``, or
        of a file of extended XYZ, ``.extxyz`` or ``.xyz``, as :meth:`write_tables` writes it; or
        arrays in SI under the same names without units: a mapping, a structured array or a data
        frame. Balls have ``x``, ``y``, ``z`` (only ``x``, ``y`` in a plane, ``x`` on a line),
        ``radius`` or ``diameter``; ``mass`` if there is no material; and, if need be, ``inertia``
        (default: a solid sphere), ``id``, the whole numbers that name them (default: 0, 1, 2, ...),
        ``kind``, names of their kinds, and ``on_site_x``, ``on_site_y``, ``on_site_z``,
        ``on_site_rotation_x`` and so on, springs to the ground (default: 0). Contacts have ``i``
        and ``j``, which name two balls, and if need be ``normal_force`` (default: Hertz's at the
        overlap of the two balls), ``normal_stiffness`` and ``shear_stiffness`` (default: those of
        Hertz and Mindlin under this force), ``torsion_stiffness`` and ``bending_stiffness``
        (default: 0), ``nx``, ``ny``, ``nz`` (default: along the line of the centres), ``arm_i`` and
        ``arm_j`` (default: the radii less half the overlap, where a flat wall counts as of radius
        zero), ``shift_1``, ``shift_2``, ``shift_3``, whole cells by which ball j is displaced
        (default: to where it is nearest, or to where the normal leads at a body that does not move
        and at an image of ball i), ``tangential_x``, ``tangential_y``, ``tangential_z``, the static
        force across the contact with which ball i acts on ball j (default: not known),
        ``torque_x``, ``torque_y``, ``torque_z``, the static torque of rolling and twist with which
        ball i acts on ball j (default: none), ``force_x``, ``force_y``, ``force_z``, the whole
        static force, from which the normal and the tangential one follow where they are not given,
        and ``overlap`` (default: that of places and radii). Other columns are not read:
        :attr:`notes` name them.

        Parameters
        ----------
        balls, contacts : the two tables. A mass of ``inf`` is a body that does not move; where its
            radius is ``inf`` too, a flat wall, its contacts need a normal.
        material : of all balls; also what :meth:`cut` needs for a floor.
        cell : lengths of the periods, m, or their vectors as rows, (p,) or (p, d); none by default.
        pbc : whether the network repeats along each vector of the cell; by default along all of
            them.
        dimension : 1, 2 or 3; by default the number of coordinates, or 2 where z is the same for
            all balls and no contact leads up or down. A flat wall may have any place.
        motions : of each ball; by default the first that the dimension allows.
        friction : whether contacts resist slip, where their shear stiffness is not given.
        prestress : whether static forces act on displacements across contacts; by default they do
            not. Contacts that resist slip bear tangential forces of the same order: without these
            there is an :class:`~granphon.base.errors.InconsistencyWarning`; and there is one if the
            static forces on a ball add up to more than 1e-3 of the mean force of a contact.
        tangential_law, slip_levers : how static tangential forces change with the overlap, and the
            levers of slip, see the class; by default as files of :meth:`write_tables` say, or
            "mindlin/force", and the levers of the law: "yade" of "yade", "arms" of others.
        columns : headings of columns that go by other names: {"radius": "R (mm)"}.
        keep_rattlers : keep balls that carry no load. By default they are left out, and
            ``left_out`` is their number.
        held_by : least number of contacts that hold a ball, see :meth:`without_rattlers`.
        bad : "refuse" or "drop" contacts that cannot be used, as those that pull, lead to no ball
            or are listed twice. By default one error tells the kinds of fault, the number of
            contacts of each and the worst three; "drop" leaves these contacts out, and an
            :class:`~granphon.base.errors.InconsistencyWarning` tells the same.

        Where forces follow from overlaps, the rounding of places with few digits makes them
        uncertain: a standard error above 6 % of the forces raises InputError. An
        :class:`~granphon.base.errors.InconsistencyWarning` tells each check of
        :func:`~granphon.validity` that fails, as forces that are not those of the overlaps, masses
        that are not those of the density, or balls that still move. Two checks give no warning:
        that of the number of rattlers, and in a lattice that of the number of contacts. The same
        warning tells a density or a Young modulus that seems to be in another unit than SI.

        Contacts without force are left out where their stiffness follows from the force. Files of
        :meth:`write_tables` also give cell, pbc, dimension, motions, prestress, tangential_law and
        slip_levers, where these are not given here, pbc for their own cell only; and the fields
        left_out, adhesive and contact_model. Such files have a digest. An
        :class:`~granphon.base.errors.UnverifiedFileWarning` tells that one of the two files has
        lost its digest, or that a file of another program may be cut, as there is no line break at
        its end.

        Raises
        ------
        InputError : a file is not as granphon has written it; a column is missing, has no unit or
            not the unit of its kind, or coordinates are in different units; forces follow from
            overlaps, and places have too few digits for these; a cell cannot be read; and what the
            class itself does not allow.
        """
        from granphon.networks.tables import read_tables

        completion = Completion(material, **options)
        source = read_tables(balls, contacts, {} if columns is None else columns, cell, pbc)
        return cls.from_source(source, completion)

    @classmethod
    @spell_out(Completion)
    def from_lammps(
        cls,
        dump: str | os.PathLike[str],
        pairs: str | os.PathLike[str],
        material: Material | None = None,
        *,
        units: str | Units | None = None,
        columns: Sequence[str] | None = None,
        step: int | None = None,
        normal_stiffness: float | None = None,
        shear_stiffness: float | None = None,
        rolling_stiffness: float | None = None,
        twisting_stiffness: float | str | None = None,
        walls: str | Sequence[str] = (),
        frozen: Mapping[str, Any] | None = None,
        **options: Unpack[CompletionOptions],
    ) -> Self:
        """Return the network in two dumps of LAMMPS: of atoms, and of pairs that touch.

        Either may be packed by gzip or Zstandard.

        Parameters
        ----------
        dump : written by ``dump custom`` or ``dump yaml``, with columns id, x, y, z (or scaled or
            unwrapped ones), radius or diameter, and mass if there is no material. Elements, or else
            types, are the kinds of the balls where there are several.
        pairs : written by ``dump local``, whatever ``dump_modify label`` calls its entries, with
            columns i, j (the ids of a pair) and, if need be, force (compressive, default: Hertz's
            at the overlap of the two balls); dx, dy, dz, the vector from j to i, as p10, p11, p12
            of ``compute pair/local`` (default: to the nearest image); tx, ty, tz, the tangential
            force on i, as p1, p2, p3 (default: not known); fx, fy, fz, the force on i, from which
            normal and tangential forces follow where they are not given; delta, the overlap
            (default: that of places and radii); rx, ry, rz, the rolling force on i, as p5, p6, p7,
            with a ``rolling_stiffness``; and twist, the torque of twist, as p9, with a
            ``twisting_stiffness`` (default: none). Where a law of rolling or twisting does not act,
            LAMMPS leaves any numbers in these columns: without the stiffness they are not read.
        material : the one that the contacts of ``hertz/material`` have in the simulation; None for
            constant stiffnesses.
        units : "si", "cgs", "micro" or "nano", LAMMPS' style of units; or the scales of "lj" units.
            By default what the dump says, or "si".
        columns : names of the columns of pairs in their order, where the dump names them otherwise.
        step : the time step, of several in the files; by default the last one. :meth:`series` reads
            them all.
        normal_stiffness, shear_stiffness : N/m, of all contacts whose law is linear, such as
            ``hooke``.
        rolling_stiffness : k of ``rolling sds``, N/m: the bending stiffness is k R^2, where R is
            the reduced radius R_i R_j / (R_i + R_j). By default contacts roll freely.
        twisting_stiffness : k of ``twisting sds``, N m, the torsion stiffness; or "marshall". By
            default contacts twist freely.
        walls : names of the ``fix wall/gran ... contacts``, whose columns f_NAME[1] to f_NAME[7]
            the dump of atoms has. A wall is a body that does not move, of infinite radius, with the
            label -1, the next one -2, and so on. Its contacts have no static torques of rolling and
            twist, which the fix does not write.
        frozen : columns of the dump of atoms, each with a value or values there: such balls do not
            move. {"type": 2}, as of ``fix freeze``; {"id": [1, 2]}. By default all of finite mass
            move.
        dimension : 1, 2 or 3; by default 2 where z is the same for all balls and no contact leads
            up or down, else 3.
        motions, friction, prestress, tangential_law, slip_levers, keep_rattlers, held_by, bad : see
            :meth:`from_table`.

        With ``prestress`` tangential forces change as the ``tangential_law`` says, and rotations
        make slip with the radii, as in LAMMPS (``slip_levers``); the part of the response that has
        no potential is left out. Contacts with walls are not in ``compute pair/local``: without
        ``walls`` they are missing. :attr:`notes` say what has not been read.

        Forces that are not those of the overlaps, masses that are not those of the density, rounded
        places and static forces out of balance are told as by :meth:`from_table`.

        A dump whose last frame is cut, as a killed LAMMPS leaves it (also within a row, or before
        the line break at its end), is read at a ``step`` before that, with a
        :class:`~granphon.base.errors.StoppedEarlyWarning`.

        Raises
        ------
        InputError : a file is missing, is not such a dump, or ends within the frame that is read; a
            column is missing; the two files are of different steps or units; places have too few
            digits for overlaps; balls or contacts cannot be used (all are told at once, the worst
            ones with their ids); and what the class itself does not allow.
        MissingPackageError : a file is packed by Zstandard, and nothing that is installed reads it.
        """
        from granphon.networks.lammps import Springs, read_dumps

        completion = Completion(material, **options)
        source = read_dumps(
            dump,
            pairs,
            units=units,
            columns=columns,
            step=step,
            springs=Springs(
                normal_stiffness, shear_stiffness, rolling_stiffness, twisting_stiffness
            ),
            walls=walls,
            frozen=frozen,
        )
        return cls.from_source(source, completion)

    @classmethod
    @spell_out(Completion)
    def from_liggghts(
        cls,
        dump: str | os.PathLike[str],
        pairs: str | os.PathLike[str],
        material: Material | None = None,
        *,
        walls: str | os.PathLike[str] | None = None,
        keywords: str | Sequence[str] | None = None,
        units: str | Units | None = None,
        columns: Sequence[str] | None = None,
        step: int | None = None,
        normal_stiffness: float | None = None,
        shear_stiffness: float | None = None,
        rolling_stiffness: float | str | None = None,
        frozen: Mapping[str, Any] | None = None,
        **options: Unpack[CompletionOptions],
    ) -> Self:
        """Return the network in dumps of LIGGGHTS: of atoms, of ``compute pair/gran/local``, and of
        ``compute wall/gran/local``.

        The formats are those of LIGGGHTS' documentation and source; the files may be packed by
        gzip or Zstandard.

        Parameters
        ----------
        dump : written by ``dump custom``, as for :meth:`from_lammps`.
        pairs : written by ``dump local`` of ``compute pair/gran/local``, with id and force, or id
            and delta. The force vectors give normal and tangential forces.
        material : as for :meth:`from_lammps`; the law is that of ``model hertz``.
        walls : written by ``dump local`` of ``compute wall/gran/local``, with pos, id and force.
            Mesh m is a body that does not move, with the label -1 - m. By default no walls.
        keywords : those of the computes, as "pos id force delta"; by default the computes are taken
            to have none, or the columns are named as for :meth:`from_lammps`. The columns of
            "history" may be any number.
        rolling_stiffness : "epsd2", the law ``rolling_friction epsd2`` without torsion, whose
            bending stiffness is the shear stiffness times R^2, where R is the reduced radius; its
            static torques stay as they are when balls move. Or N/m, the constant k of k R^2. By
            default contacts roll freely.
        units, columns, step, normal_stiffness, shear_stiffness, frozen, dimension, motions,
            friction, prestress, tangential_law, slip_levers, keep_rattlers, held_by, bad : see
            :meth:`from_lammps`; but slip has the arms as levers, and the tangential law is
            "liggghts", or "mindlin/force" if a ``shear_stiffness`` is given.

        Raises
        ------
        InputError : the keywords do not give the number of columns; and as :meth:`from_lammps`.
        MissingPackageError : as :meth:`from_lammps`.
        """
        from granphon.networks.lammps import Springs
        from granphon.networks.liggghts import read_liggghts

        completion = Completion(material, **options)
        source = read_liggghts(
            dump,
            pairs,
            walls,
            keywords=keywords,
            units=units,
            columns=columns,
            step=step,
            springs=Springs(normal_stiffness, shear_stiffness, rolling_stiffness),
            frozen=frozen,
        )
        return cls.from_source(source, completion)

    @classmethod
    @spell_out(Completion)
    def from_mercury(
        cls,
        fstat: str | os.PathLike[str],
        particles: str | os.PathLike[str],
        material: Material | None = None,
        *,
        time: float | None = None,
        pbc: Sequence[bool] | None = None,
        frozen: Mapping[str, Any] | None = None,
        normal_stiffness: float | None = None,
        shear_stiffness: float | None = None,
        **options: Unpack[CompletionOptions],
    ) -> Self:
        """Return the network in two files of MercuryDPM: contacts, and balls.

        The formats are those of MercuryDPM's documentation and source; the files may be packed by
        gzip or Zstandard. Wall w is a body that does not move, with the label -1 - w.

        Parameters
        ----------
        fstat : the file .fstat, in which a contact of two balls that move stands twice.
        particles : the file .data, or .restart, which also has masses, fixed balls and periods.
        material : of the Hertz-Mindlin law, and of the masses of a file .data; None for constant
            stiffnesses.
        time : s, of several in the files; by default the last one of ``particles``.
        pbc : along which axes the network repeats: by default as the periodic boundaries of a file
            .restart say, and along none with a file .data, whose cell is its box.
        frozen : as {"info": 1}: balls of a file .data that do not move. By default those whose
            contacts stand in ``fstat`` from the other ball alone.
        normal_stiffness, shear_stiffness : N/m, of all contacts of a linear law.
        dimension, motions, friction, prestress, tangential_law, slip_levers, keep_rattlers,
            held_by, bad : see :meth:`from_table`.

        Raises
        ------
        InputError : a file is missing, of another format, or cut; a file does not have the
            ``time``, or no ball at this time; ``frozen`` is given with a file .restart; and as
            :meth:`from_table`.
        MissingPackageError : as :meth:`from_lammps`.
        """
        from granphon.networks.lammps import Springs
        from granphon.networks.mercury import read_mercury

        completion = Completion(material, **options)
        source = read_mercury(
            fstat,
            particles,
            time=time,
            pbc=pbc,
            frozen=frozen,
            springs=Springs(normal_stiffness, shear_stiffness),
        )
        return cls.from_source(source, completion)

    @classmethod
    def series(
        cls, program: str, dump: Any, pairs: Any, **options: Any
    ) -> Iterator[tuple[float, ContactNetwork]]:
        """Yield each time step that two files of several steps both have, with its network, in
        ascending order.

        ``program`` is "lammps" or "liggghts", whose steps are whole numbers, or "mercury", whose
        files .fstat and .data have times, s. ``dump`` and ``pairs`` are the two paths that its
        reader takes, and ``options`` are those of the reader without ``step`` or ``time``. Each
        file is read once, when the first network is asked for.

        Raises :class:`~granphon.base.errors.InputError` for another program, for a ``step`` or
        ``time`` among the options, and for files without a common step; also these errors are
        raised only when the first network is asked for. Errors of the reader are raised at the step
        at which they occur. Frames that are cut, as a killed program leaves the last one, end the
        series, with a :class:`~granphon.base.errors.StoppedEarlyWarning`.
        """
        steps: list[float]
        first: Any
        second: Any
        is_mercury = one_of("program", program, ("lammps", "liggghts", "mercury")) == "mercury"
        argument = "time" if is_mercury else "step"
        if argument in options:
            fault = f"{argument}={brief(options[argument])} is given for a series of all"
            raise InputError(fault, mend=f"Leave {argument} out, or read one network")
        if is_mercury:
            from granphon.networks.mercury import open_times

            steps, first, second = open_times(dump, pairs)
        else:
            from granphon.networks.dumps import Dump, open_series

            steps, first, second = open_series(dump, pairs)
            if program == "liggghts" and options.get("walls") is not None:
                options["walls"] = Dump.open(options["walls"], "entries")
        for step in steps:
            yield step, READERS[program](first, second, **{argument: step}, **options)

    @classmethod
    def read(cls, program: str, *files: Any, **options: Any) -> ContactNetwork:
        """Return the network in the ``files`` of a program, by the reader of this name.

        "tables" is :meth:`from_table`, "lammps" :meth:`from_lammps`, "liggghts"
        :meth:`from_liggghts`, "mercury" :meth:`from_mercury`; others are those of
        :func:`~granphon.register_reader`. ``options`` are the reader's.

        Errors of granphon's own that the reader raises pass as they are. Raises
        :class:`~granphon.base.errors.InputError` for a name without a reader, for any other error
        of the reader, which the message tells, and if the reader returns no network.
        """
        reader = READERS[one_of("program", program, READERS)]
        try:
            network: Any = reader(*files, **options)
        except GranphonError:
            raise
        except Exception as error:
            fault = f"{READERS.describe(program)} fails: {type(error).__name__}: {error}"
            raise InputError(fault, mend="Mend it, or the files") from error
        if not isinstance(network, ContactNetwork):
            fault = f"{READERS.describe(program)} returns {brief(network)}"
            mend = "Let it return a granphon.ContactNetwork, as from_table makes one"
            raise InputError(fault, mend=mend)
        return network

    @classmethod
    def from_source(cls, source: Source, completion: Completion) -> Self:
        """Return the network that is read from a ``source``, without its rattlers unless
        ``completion.keep_rattlers``.

        The network keeps as its :attr:`reading` what is known of the source beside the numbers.
        Warns where the numbers contradict each other
        (:func:`~granphon.networks.consistency.compare_numbers`).
        """
        network_fields, notes = source.complete(completion)
        whole_network = cls(**network_fields)
        network = whole_network
        if not completion.keep_rattlers:
            network = whole_network.without_rattlers(completion.held_by)
        # the balls of the source that the network still has: where the source has no labels, the
        # labels of the network are the indices of the balls in the source
        is_kept: Any = slice(None)
        if network is not whole_network and network.labels is not None:
            all_labels = whole_network.labels
            if all_labels is None:
                all_labels = np.arange(whole_network.n_balls)
            is_kept = np.isin(all_labels, network.labels)
        network._cache[_READING_KEY] = source.describe(is_kept, notes)
        warn_of_faults(network)
        return network

    @property
    def reading(self) -> Reading | None:
        """What the reader of the files of this network knows beside the numbers of the network;
        None for a network that was not read, or that has been changed since.
        """
        return self._cache.get(_READING_KEY)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader of the files of this network has passed over, and why; empty for a
        network that was not read, or that has been changed since.
        """
        return self.reading.notes if self.reading else ()

    def write_tables(self, balls: str | os.PathLike[str], contacts: str | os.PathLike[str]) -> None:
        """Write the network as two CSV files, from which :meth:`from_table` reads the same network,
        to the last digit; with ``keep_rattlers=True`` if it has balls that carry no load. Three
        things are not written: ``lattice``, ``shape``, and the contact model of a user's own law.

        A file whose name ends with ``.extxyz`` or ``.xyz`` is extended XYZ instead, for OVITO and
        ASE, in SI. Balls stand at their centres, with three further columns: ``masses``;
        ``load``, the sum of the normal forces on the ball, N; and ``rattler``, 1 if the ball
        carries no load, else 0. Contacts stand at their places, with the vector ``force``, the
        static force with which ball i acts on ball j, N. Each file has a digest of the rest.
        Folders are made if need be.

        Raises :class:`~granphon.base.errors.InputError` for what is no name of a file, for two
        names of one file, for ``labels`` of the size 2^53 or more, which could not be read again,
        and, in a CSV file, for ``kinds`` with spaces at their ends, which could not either; and
        OutputError for files that granphon has not written, for folders, and if a file cannot be
        written. Neither file is written then, unless one of them is at its place already when the
        other cannot be moved there.
        """
        from granphon.networks.tables import write_tables

        write_tables(self.storable(), balls, contacts)

    def write_dumps(self, atoms: str | os.PathLike[str], pairs: str | os.PathLike[str]) -> None:
        """Write the network as two dumps of LAMMPS, in SI units, for OVITO, LAMMPS and
        :meth:`from_lammps`, which reads the same balls, forces and normals from them; with
        ``keep_rattlers=True`` if balls carry no load.

        ``atoms`` has the columns id, type (of the kinds of the balls), x, y, z, radius, mass, and
        force, the sum of the normal forces on the ball, N. ``pairs`` has a bond for each contact: i
        and j, the ids of its balls, force, N, dx, dy, dz, the vector from j to i, m, and tx, ty,
        tz, the tangential force on i, N, if these are known, with rx, ry, rz, the rolling force on
        i, N, and twist, the torque of twist, N m, if contacts have static torques;
        :meth:`from_lammps` reads these with a ``rolling_stiffness`` and a ``twisting_stiffness``,
        which may be 0. Contacts with flat walls are columns of ``atoms``, as LAMMPS writes those of
        ``fix wall/gran ... contacts``: f_wall1[1] to f_wall1[8], and so on. :meth:`from_lammps`
        reads these walls, ``prestress``, ``tangential_law`` and ``slip_levers`` from the dumps.
        Stiffnesses are left out, as they follow from the material, and against rolling and twist
        from the ``rolling_stiffness`` and the ``twisting_stiffness`` that the reader is given. The
        names of the kinds, arms between balls, contacts of two flat walls, and ``left_out`` are not
        in the dumps either. Folders are made if need be.

        Warns (:class:`~granphon.base.errors.InconsistencyWarning`) of four losses that change
        modes: stiffnesses that are not of one material, with their greatest difference; moments of
        inertia that are not those of solid balls, if balls rotate; springs to the ground; static
        torques at flat walls. Also warns of adhesion: :meth:`from_lammps` refuses contacts that
        pull.
        :meth:`write_tables` keeps all of these.

        Raises :class:`~granphon.base.errors.InputError` for a cell whose first vector is not along
        x, whose second one leaves the xy plane, or of which one leads down along its own axis, for
        what is no name of a file, for two names of one file, for ``labels`` of the size 2^53 or
        more, which could not be read again, and for negative ``labels`` that the reader gives to
        walls; and OutputError for files that are there and are not such dumps of granphon's own, as
        dumps of LAMMPS, and if a file cannot be written. Neither file is written then, unless one
        of them is at its place already when the other cannot be moved there.
        """
        from granphon.networks.lammps import write_dumps

        write_dumps(self, atoms, pairs)


#: readers of the files of other programs, by the name of the program
READERS: Registry[Callable[..., ContactNetwork]] = Registry("reader")
READERS.own("tables", ContactNetwork.from_table)
READERS.own("lammps", ContactNetwork.from_lammps)
READERS.own("liggghts", ContactNetwork.from_liggghts)
READERS.own("mercury", ContactNetwork.from_mercury)


def register_reader(
    name: str, read: Callable[..., ContactNetwork]
) -> Callable[..., ContactNetwork]:
    """Make the reader of another program's contacts known by a name, to
    :meth:`ContactNetwork.read`.

    ``read`` takes the paths of files, and options, and returns a :class:`~granphon.ContactNetwork`;
    :meth:`ContactNetwork.from_table` makes one of arrays in SI. The function ``read`` itself is
    returned. Raises :class:`~granphon.base.errors.InputError` for what cannot be called, for a name
    that another reader has, and for one that tables cannot show.
    """
    if not callable(read):
        raise InputError(f"{brief(read)} reads no files", mend="Give a function of paths")
    return READERS.add(name, read, read)


def given_network(source: Any) -> ContactNetwork:
    """Return the network of ``source``, the argument of a public call: the source itself, or the
    network of a state, a sample or Atoms.

    Raises :class:`~granphon.base.errors.InputError` if the source has none.
    """
    if isinstance(source, ContactNetwork):
        return source
    # the calculator of Atoms makes a network of them
    calculator = getattr(source, "calc", None)
    make_network = getattr(calculator, "contact_network", None)
    network = getattr(source, "network", None) if make_network is None else make_network(source)
    if isinstance(network, ContactNetwork):
        return network
    refuse_unpressed(source)
    mend = "Give a state, a sample of a simulation, a ContactNetwork, or Atoms with a HertzMindlin"
    raise InputError(f"there is no network of contacts in {brief(source)}", mend=mend)


def refuse_unpressed(source: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a crystal or a medium, which must be
    pressed first.
    """
    is_unpressed = hasattr(source, "at_force") and not isinstance(source, type)
    if is_unpressed:
        name = "crystal" if hasattr(source, "cut") else "medium"
        why = "Its contacts are stiff under a load only"
        mend = (
            f"Press it, and give its state: {name}.at_force(...), in N, or another of its methods"
            f" at_..."
        )
        raise InputError(f"{brief(source)} has no load", why, mend)


def _read_periods(pbc: Any) -> tuple[bool, ...]:
    """Return three truth values; InputError for what is not three of them."""
    flags = pbc.tolist() if isinstance(pbc, np.ndarray) else pbc
    is_list = isinstance(flags, Sequence) and not isinstance(flags, str)
    if not is_list or len(flags) != 3:
        fault = f"pbc of the network is {brief(pbc)}"
        raise InputError(fault, mend="Give three truth values, one for each vector of the cell")
    return tuple(require("pbc", truth, value) for value in flags)


def _find_mean(values: Array) -> float:
    """Return the mean of ``values`` (m,), of which there is one or more: their first value plus the
    mean of the differences from it, which is exact where all values are equal.
    """
    return float(values[0] + np.mean(values - values[0]))


def number_pieces(i: Index, j: Index, moving: Flags) -> Index:
    """Return (n,) the number, from 0, of the piece to which each ball belongs: a set of balls that
    contacts between balls that move join. A body that does not move is a piece of its own.

    ``i`` and ``j`` (n_c,) are the balls of each contact, and ``moving`` (n,) says which balls move.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    both_move = moving[i] & moving[j]
    n_balls = len(moving)
    ones = np.ones(np.count_nonzero(both_move))
    graph = coo_array((ones, (i[both_move], j[both_move])), shape=(n_balls, n_balls))
    _count, numbers = connected_components(graph, directed=False)
    return np.asarray(numbers, np.intp)
