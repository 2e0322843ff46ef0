"""The completion of networks of which a program of discrete elements has left a part of the
numbers: the other numbers follow from these.

Stiffnesses follow from force and material by the laws of Hertz and Mindlin, and masses from the
density. Moments of inertia are those of solid spheres. Shifts lead to the nearest image, and
normals lie along the line of the centres.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Self

import numpy as np

from granphon.balls.ball import BALL_LIMITS, WRONG_UNIT, Ball
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import HertzLaw, harmonic_diameter
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions, default_motions
from granphon.balls.on_site import name_springs
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, message, warn_caller
from granphon.base.text import counted
from granphon.base.validation import is_one_of, one_of, whole_number
from granphon.networks.faults import MOST_NAMED, settle
from granphon.networks.sources import (
    LARGEST_NUMBER,
    MOST_STEPS,
    SOLID_INERTIA,
    TANGENTIAL_LAWS,
    Balls,
    Completion,
    Contacts,
    Reading,
    are_across,
    are_independent,
    find_errors_of_overlaps,
    find_repeated,
    find_rounding,
    note_pulling,
    span_distance,
)

#: greatest gap or overlap of two balls, over the sum of their radii, at which they may be in
#: contact
_REACH = 0.25
#: greatest error of a vector between two balls, over the sum of their radii, that is put down to
#: rounding in a file
_VECTOR_TOLERANCE = 1e-2
#: difference of z, over the largest radius, up to which balls are in one plane, and component of a
#: normal along z up to which the normal lies there: the rounding in a file
_LEVEL_TOLERANCE = 1e-9
#: least relative decrease of the length of a period that counts as one: less is rounding
_LEAST_SHORTENING = 1e-9
#: standard error of the forces that follow from overlaps, over the forces, above which these are
#: refused: frequencies are off by 1 %, as far as elastic constants are known
_MOST_ERROR = 6e-2
#: difference from one of the median ratio of the overlaps of a source to those of places, from
#: which on there is a warning
_LEAST_DEVIATION = 0.049
#: factor between the overlap of a source and that of places, above which there is a warning of a
#: single contact
_MOST_FACTOR = 10.0
#: least overlap, and least force of the law at an overlap, over the mean of all contacts, for which
#: a warning names a contact: weaker contacts may have opened since
_LEAST_SHARE = 1e-2
#: part of a force vector across the normal, over the part along it, up to which the vector counts
#: as a normal force
_ACROSS_TOLERANCE = 1e-3
#: least component of the direction of a normal along the line of the centres for which a body that
#: does not move is a ball
_LEAST_COSINE = 0.999


@dataclass(frozen=True)
class _Pairs:
    """The pairs of balls that contacts join.

    Attributes
    ----------
    i, j : (n_c,) indices of the two balls.
    radii_i, radii_j : (n_c,) radii of the two balls, m; infinite for a flat wall.
    shift : (n_c, 3) whole cells by which ball j is displaced.
    normal : (n_c, 3) unit vectors from ball i to ball j.
    overlap : (n_c,) m; zero where it is not known.
    has_overlap : (n_c,) whether the overlap is known: a body that does not move need not be a ball,
        and has no overlap that follows from its place and radius.
    """

    i: Index
    j: Index
    radii_i: Array
    radii_j: Array
    shift: Index
    normal: Array
    overlap: Array
    has_overlap: Flags

    def select(self, rows: Any) -> Self:
        """Return some of the pairs, given by their indices or by truth values (n_c,)."""
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @property
    def arms(self) -> dict[str, Array]:
        """The fields ``arm_i`` and ``arm_j`` (n_c,) of the network, m: the distances from the
        centres to the middle of the overlap. A flat wall does not turn: its arm has no meaning, and
        is counted from its surface.
        """
        arms = {}
        for name, radii in (("arm_i", self.radii_i), ("arm_j", self.radii_j)):
            arms[name] = np.where(np.isfinite(radii), radii, 0.0) - 0.5 * self.overlap
        return arms

    @property
    def reduced_radii(self) -> Array:
        """(n_c,) R_i R_j / (R_i + R_j), m: the radius of the ball at a flat wall, and zero between
        two flat walls, which do not roll.
        """
        radii = 0.25 * self._find_diameters()
        return np.where(np.isfinite(radii), radii, 0.0)

    def _find_diameters(self) -> Array:
        """Return the harmonic means (n_c,) of the diameters, m; twice the diameter of a ball at a
        flat wall, whose curvature is zero, and infinite between two flat walls.
        """
        small = np.minimum(self.radii_i, self.radii_j)
        large = np.maximum(self.radii_i, self.radii_j)
        is_flat = np.isinf(large)
        # an infinite radius is replaced, as the harmonic mean with it would be nan
        between_balls = harmonic_diameter(2.0 * small, 2.0 * np.where(is_flat, small, large))
        return np.where(is_flat, 4.0 * small, between_balls)

    def find_coefficient(self, material: Material) -> Array:
        """Return the coefficients (n_c,), N/m^(3/2), of Hertz's law between two balls, or a ball
        and a flat wall, of a ``material``.
        """
        # the coefficient is proportional to the root of the diameter
        coefficient_at_1_m = HertzLaw.between(material, 1.0).coefficient
        return np.asarray(coefficient_at_1_m * np.sqrt(self._find_diameters()))


@dataclass(frozen=True)
class Source:
    """The content of a source, which may be files of a program or arrays.

    ``contacts`` are one list of contacts or several, ``cell`` (3, 3) has the vectors of the cell as
    rows, m, and ``pbc`` (3,) says which of them are periods. ``notes`` say what has been passed
    over, and why. The other fields have the names and meanings of the fields of
    :class:`~granphon.networks.network.ContactNetwork`; None where the source does not have them.
    """

    balls: Balls
    contacts: tuple[Contacts, ...]
    cell: Array
    pbc: Flags
    dimension: int | None = None
    motions: str | None = None
    prestress: bool = False
    left_out: int = 0
    adhesive: bool = False
    contact_model: ContactModel | None = None
    notes: tuple[str, ...] = ()
    tangential_law: str = "mindlin/force"
    slip_levers: str | None = None

    def complete(self, completion: Completion) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the fields of the network but ``lattice`` and ``shape``, by name, in SI units, and
        notes on contacts that are left out.

        The arguments in ``completion`` take precedence over the fields of the source. Arguments,
        warnings and errors are those of
        :meth:`granphon.networks.network.ContactNetwork.from_table`.
        """
        balls = self.balls
        material = completion.material
        source = replace(self, **completion.of_network)
        positions = np.zeros((len(balls.positions), 3))
        positions[:, : balls.positions.shape[1]] = balls.positions
        dimension = self._find_dimension() if source.dimension is None else source.dimension
        dimension = whole_number("dimension", dimension, 1, 3)
        pbc = self.pbc & (np.arange(3) < dimension)
        if material is not None:
            self._judge_material(material)
        masses = self._find_masses(material)
        contact_fields, notes = self._find_contacts(positions, pbc, completion)
        resists_slip = bool(np.any(contact_fields["shear_stiffness"]))
        # on a line nothing is across the normals
        bears_tangential_forces = dimension > 1 and resists_slip
        lacks_tangential_forces = "tangential_force" not in contact_fields
        if source.prestress and bears_tangential_forces and lacks_tangential_forces:
            _warn_of_missing_forces(self.contacts[0])
        motions = source.motions
        if motions is None:
            motions = default_motions(dimension).name
        network_fields = {
            "cell": self.cell,
            "pbc": tuple(pbc.tolist()),
            "positions": positions,
            "radii": balls.radii,
            "masses": masses,
            "inertias": self._find_inertias(masses),
            **contact_fields,
            "motions": motions,
            "dimension": dimension,
            "prestress": source.prestress,
            "left_out": self.left_out,
            "labels": balls.labels,
            "kinds": balls.kinds,
            "adhesive": self.adhesive,
            "contact_model": self._find_model(material, resists_slip=resists_slip),
            "on_site": self._list_on_site(motions, dimension),
            "tangential_law": source.tangential_law,
            "slip_levers": source._find_levers(),
        }
        return network_fields, notes

    def _find_levers(self) -> str:
        """Return the levers of slip of the source, by default those of its tangential law;
        InputError for another law, which has none.
        """
        if self.slip_levers is not None:
            return self.slip_levers
        law = one_of("tangential_law", self.tangential_law, TANGENTIAL_LAWS)
        return TANGENTIAL_LAWS[law].levers

    def _find_inertias(self, masses: Array) -> Array:
        """Return the moments of inertia (n,), kg m^2: those of the source, or else those of solid
        balls with these ``masses`` (n,), kg; infinite for balls that the source says do not move.
        """
        balls = self.balls
        inertias = balls.inertias
        if inertias is None:
            inertias = SOLID_INERTIA * masses * balls.radii**2
        return inertias if balls.still is None else np.where(balls.still, np.inf, inertias)

    def _find_contacts(
        self, positions: Array, pbc: Flags, completion: Completion
    ) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the fields of the contacts of all lists, by name, each (n_c,) or (n_c, 3), and
        notes on contacts that are left out because they have no force.

        ``positions`` are (n, 3), m; ``pbc`` (3,) says along which vectors the network repeats. The
        tangential forces are left out if a list has none, or if those of all lists are the rounding
        of force vectors (:attr:`_Joined.is_normal`). If some lists have static torques of rolling
        and twist, the torques of the other lists are zero. Raises and warns as :meth:`_join_balls`
        and :meth:`_Joined.complete` do.
        """
        joined_lists = self._join_balls(positions, pbc, drops=completion.bad == "drop")
        fields_of_lists = [joined.complete(self.balls, completion) for joined in joined_lists]
        if any("contact_torque" in fields_of_list for fields_of_list in fields_of_lists):
            for fields_of_list in fields_of_lists:
                no_torques = np.zeros((len(fields_of_list["i"]), 3))
                fields_of_list.setdefault("contact_torque", no_torques)
        contact_fields = _concatenate(fields_of_lists)
        if all(joined.is_normal or joined.tangential_force is None for joined in joined_lists):
            contact_fields.pop("tangential_force", None)
        notes = []
        for contacts_of_list, joined in zip(fields_of_lists, joined_lists, strict=True):
            n_all = len(joined.contacts)
            n_open = n_all - len(contacts_of_list["i"])
            if n_open:
                notes.append(
                    f"{joined.contacts.name}: {n_open} of {counted(n_all, 'contact')} without force"
                    " left out, as open contacts have no stiffness by Hertz's law."
                )
        return contact_fields, tuple(notes)

    def describe(self, is_kept: Any, notes: tuple[str, ...]) -> Reading:
        """Return what the source tells of its network beside the numbers of the network.

        ``is_kept`` selects the balls of the source that the network has, as (n,) truth values or a
        slice; ``notes`` are those of :meth:`complete`.
        """
        rounding = np.zeros((len(self.balls.radii), 3))
        rounding[:, : self.balls.rounding.shape[1]] = self.balls.rounding
        return Reading(
            balls=self.balls.name,
            contacts=self.contacts[0].name,
            notes=(*self.notes, *notes),
            rounding=rounding[is_kept],
            radius_rounding=self.balls.radius_rounding[is_kept],
        )

    def _list_on_site(self, motions: str, dimension: int) -> Array | None:
        """Return the stiffnesses (n, motions) of springs to the ground; None without springs.
        InputError for a spring of a motion that balls do not have.
        """
        springs = self.balls.on_site
        allowed = allowed_motions(dimension)
        if not springs or not is_one_of(motions, allowed):  # the network refuses other motions
            return None
        names = name_springs(allowed[motions])
        other_names = [name for name in springs if name not in names and np.any(springs[name])]
        if other_names:
            problem = f"{self.balls.name} has springs to the ground on_site_{other_names[0]}"
            why = f"Balls with the motions {motions!r} have no such motion"
            raise InputError(problem, why, f"Give on_site of {', '.join(names)}")
        zeros = np.zeros(len(self.balls.radii))
        columns = [springs.get(name, zeros) for name in names]
        return np.stack(columns, axis=1) if np.any(columns) else None

    def _find_model(self, material: Material | None, *, resists_slip: bool) -> ContactModel | None:
        """Return the contact model of balls of the ``material``, with friction if contacts resist
        slip. Without a material it is the model of the source, None if the source has none.
        """
        if material is None:
            return self.contact_model
        radii = self.balls.radii
        ball = Ball(material, 2.0 * float(np.mean(radii[np.isfinite(radii)])))
        return ContactModel((ball,), friction=resists_slip, own_radii=True)

    def _find_masses(self, material: Material | None) -> Array:
        """Return the masses (n,), kg, infinite for bodies that do not move: those of the source, or
        else those of solid balls of the ``material``. InputError if the source has no masses and
        there is no material.
        """
        balls = self.balls
        masses = balls.masses
        if masses is None:
            if material is None:
                problem = f"{balls.name} has no column 'mass', and no material is given"
                raise InputError(problem, mend="Give the masses, or the material of the balls")
            with np.errstate(all="ignore"):  # radii out of range are refused later
                masses = material.density * (4.0 / 3.0 * math.pi) * balls.radii**3
        return np.where(balls.fixed, np.inf, masses)

    def _join_balls(self, positions: Array, pbc: Flags, *, drops: bool) -> list[_Joined]:
        """Return the lists of contacts with the balls that they join, without contacts that have
        faults.

        ``positions`` are (n, 3), m; ``pbc`` (3,) says along which vectors of the cell the network
        repeats. Raises InputError for a cell out of range, for periods that are not independent,
        and without a ball. Raises one InputError that tells all balls and contacts that cannot be
        used. With ``drops``, if only contacts are at fault, these are left out instead, with one
        warning.
        """
        lengths = np.max(np.abs(self.cell), axis=1)
        is_in_range = (lengths < LARGEST_NUMBER) & ((lengths > 1.0 / LARGEST_NUMBER) | ~self.pbc)
        if not np.all(is_in_range):
            axis = int(np.argmin(is_in_range))
            name = "period" if self.pbc[axis] else "vector"
            problem = f"{name} {axis} of the cell is {self.cell[axis].tolist()} m"
            raise InputError(problem, mend="Give a vector of finite length, in m, or fewer of them")
        if not are_independent(self.cell[pbc]):
            problem = "the periodic vectors of the cell are not independent of each other"
            raise InputError(problem, mend="Give other vectors, or name fewer as periodic")
        if np.all(self.balls.radii == np.inf):
            what = "flat walls alone" if len(self.balls.radii) else "no rows"
            raise InputError(f"{self.balls.name} has no balls: {what}", mend="Give one or more")
        ball_faults = self.balls.find_faults()
        places = _Places(self.balls, positions, self.cell, pbc, ball_faults.is_bad)
        joinings = [_Joining(places, contacts, self.adhesive) for contacts in self.contacts]
        joined_lists = [joining.join() for joining in joinings]
        settle([ball_faults, *(joining.faults for joining in joinings)], drops)
        return joined_lists

    def _find_dimension(self) -> int:
        """Return the number of coordinates that the balls have; but 2 if the balls have three
        coordinates, and all balls and contacts lie in a plane of one z (:meth:`_is_level`).
        """
        n_axes = self.balls.positions.shape[1]
        return 2 if n_axes == 3 and self._is_level() else n_axes

    def _is_level(self) -> bool:
        """Whether all balls are at one height z, and no contact leads up or down, by its normal,
        its vector or its shift. A flat wall may have any place. False if there are flat walls
        alone.
        """
        balls = self.balls
        is_ball = np.isfinite(balls.radii)  # the radius of a flat wall is infinite
        heights = balls.positions[is_ball, 2]
        if not heights.size:
            return False
        tolerance = _LEVEL_TOLERANCE * np.max(balls.radii[is_ball])  # m
        with np.errstate(all="ignore"):  # places and cells out of range are refused later
            rises: list[tuple[Array, float]] = [(heights - heights[0], tolerance)]
            for contacts in self.contacts:
                if contacts.normal is not None:
                    rises.append((contacts.normal[:, 2], _LEVEL_TOLERANCE))
                if contacts.vector is not None:
                    rises.append((contacts.vector[:, 2], tolerance))
                if contacts.shift is not None:
                    rises.append((contacts.shift @ self.cell[:, 2], tolerance))
        return not any(np.any(np.abs(rise) > limit) for rise, limit in rises)

    def _judge_material(self, material: Material) -> None:
        """Warn of a density or a Young modulus that was probably given in another unit; of the
        density only if the source has no masses.
        """
        for attribute, name, unit, limit, at_least in BALL_LIMITS.values():
            # where the source has masses, nothing follows from the density
            is_used = attribute != "material.density" or self.balls.masses is None
            if not attribute.startswith("material.") or not is_used:
                continue
            value = float(getattr(material, attribute.removeprefix("material.")))
            is_beyond = value < limit if at_least else value > limit
            if is_beyond:
                side = "below" if at_least else "above"
                fault = f"the {name} of the material is {value:g} {unit}, {side} {limit:g} {unit}"
                text = message(fault, WRONG_UNIT.capitalize())
                warn_caller(text, InconsistencyWarning)


@dataclass(frozen=True)
class _Places:
    """The balls that contacts join, their ``positions`` (n, 3), m, and the ``cell`` (3, 3), m.

    ``pbc`` (3,) says along which vectors of the cell the balls repeat, and ``is_bad`` (n,) which
    balls have faults.
    """

    balls: Balls
    positions: Array
    cell: Array
    pbc: Flags
    is_bad: Flags

    @property
    def axes(self) -> Index:
        """The axes of the periods, (p,)."""
        return np.flatnonzero(self.pbc)

    @property
    def periods(self) -> Array:
        """The periods (p, 3), m."""
        return self.cell[self.axes]


class _Joining:
    """The step from one list of contacts, which names balls by their labels, to the pairs of balls
    that it joins.

    ``faults`` collects the contacts of the list that cannot be used; :meth:`join` fills it.
    """

    def __init__(self, places: _Places, contacts: Contacts, adhesive: bool) -> None:
        """Begin with all ``contacts`` of the list, without faults; ``adhesive`` says whether
        contacts may pull.
        """
        self.places = places
        self.contacts = contacts
        self.adhesive = adhesive
        self.faults = contacts.start_faults()

    def join(self) -> _Joined:
        """Return the contacts without faults, with the balls that they join, and their forces.

        The contacts with faults are noted in ``faults``, each with the first fault that is found.
        Warns if overlaps of the source are not those of places and radii
        (:func:`_compare_overlaps`).
        """
        contacts = self.contacts
        faults = self.faults
        i, j = self._find_ends()
        contacts.note_numbers(faults, adhesive=self.adhesive)
        # shifts and overlaps follow from the places and radii of balls: those of a ball with a
        # fault cannot be used
        is_bad_ball = self.places.is_bad
        is_fine = faults.narrow(~(is_bad_ball[i] | is_bad_ball[j]))
        contacts = contacts.select(is_fine)
        pairs = self._find_pairs(contacts, i[is_fine], j[is_fine])
        normal_force, tangential_force = self._split_forces(contacts, pairs)
        if contacts.overlap is not None:
            pairs = self._take_overlaps(contacts, pairs)
        self._note_arms(contacts, pairs)
        is_fine = faults.narrow()
        if normal_force is not None:
            normal_force = normal_force[is_fine]
        if tangential_force is not None:
            tangential_force = tangential_force[is_fine]
        has_vectors_alone = contacts.tangential_force is None
        return _Joined(
            contacts.select(is_fine),
            pairs.select(is_fine),
            normal_force,
            tangential_force,
            is_normal=has_vectors_alone and _is_rounding(tangential_force, normal_force),
        )

    def _find_ends(self) -> tuple[Index, Index]:
        """Return the indices (n_c,) of balls i and (n_c,) of balls j, found by their labels; 0 for
        a label that no ball has.

        Contacts with such a label are noted as faults, and so are contacts of a ball with itself
        where nothing repeats.
        """
        balls = self.places.balls
        n_balls = len(balls.positions)
        labels = np.arange(n_balls) if balls.labels is None else balls.labels
        order = np.argsort(labels, kind="stable")
        sorted_labels = labels[order]
        why = f"There, {counted(n_balls, 'ball has an id', 'balls have ids')}"
        if balls.labels is None:
            why = f"There, balls are 0 to {n_balls - 1}"
        ends = list[Index]()
        is_missing = np.zeros(len(self.contacts), bool)
        for end_labels in (self.contacts.i, self.contacts.j):
            # the rank at which each label stands among the sorted labels, if it is one of them
            ranks = np.minimum(np.searchsorted(sorted_labels, end_labels), n_balls - 1)
            is_found = sorted_labels[ranks] == end_labels
            is_missing |= ~is_found
            ends.append(np.where(is_found, order[ranks], 0))
        self.faults.note(is_missing, f"a ball that is not among those of {balls.name}", why=why)
        i, j = ends
        if not self.places.axes.size:
            self.faults.note(i == j, "one ball at both ends")
        return i, j

    def _find_pairs(self, contacts: Contacts, i: Index, j: Index) -> _Pairs:
        """Return the pairs of balls i and j (m,) that ``contacts`` (m,) join, with shifts, normals
        and overlaps.

        Notes, as faults, contacts with a flat wall that have no normal, contacts of two flat walls
        that have no stiffness, contacts whose balls are not near each other, contacts that are
        listed twice, and what :meth:`_take_shift` does.
        """
        balls = self.places.balls
        radii_i = balls.radii[i]
        radii_j = balls.radii[j]
        sum_of_radii = radii_i + radii_j  # infinite at a flat wall
        is_still = balls.fixed[i] | balls.fixed[j]
        if contacts.normal is None:
            words = "a flat wall, and no normal"
            self.faults.note(np.isinf(sum_of_radii), words, mend="Give nx, ny and nz")
        if contacts.normal_stiffness is None:
            are_flat = np.isinf(radii_i) & np.isinf(radii_j)
            words = "two flat walls, which no law makes stiff"
            self.faults.note(are_flat, words, mend="Give normal_stiffness, or leave them out")
        shift = self._take_shift(contacts, i, j, is_still)
        positions = self.places.positions
        vector = positions[j] + shift @ self.places.cell - positions[i]
        distance = np.linalg.norm(vector, axis=1)
        is_near = np.abs(sum_of_radii - distance) <= _REACH * sum_of_radii
        normal = contacts.normal
        has_overlap = np.isfinite(sum_of_radii)
        if normal is None:
            # the normal of two balls in one place is nan: they count as not near, below
            with np.errstate(invalid="ignore", divide="ignore"):
                normal = vector / distance[:, None]
        else:
            # a body that does not move need not be a ball: its overlap is that of place and radius
            # only if the body is near, and the normal is along the line of the centres
            is_along = np.einsum("ca,ca->c", normal, vector) >= _LEAST_COSINE * distance
            has_overlap = ~is_still | (has_overlap & is_near & is_along)
        self.faults.note(
            has_overlap & ~is_near,
            "balls that are not near each other, by the distance between their surfaces",
            values=np.where(has_overlap, distance - sum_of_radii, 0.0),
            unit="m",
            mend="Compare the cell and the units",
        )
        overlap = np.where(has_overlap, sum_of_radii - distance, 0.0)
        pairs = _Pairs(i, j, radii_i, radii_j, shift, normal, overlap, has_overlap)
        self._note_repeated(pairs)
        return pairs

    def _take_shift(self, contacts: Contacts, i: Index, j: Index, is_still: Flags) -> Index:
        """Return the whole cells (m, 3) by which balls j are displaced: those of the source, or
        else those that :meth:`_find_shift` finds, which has the same arguments.

        Notes, as faults, contacts across a side that is not periodic; and, where shifts are sought,
        vectors that lead to no image of ball j, balls that touch at several images, and balls that
        are too many cells apart.
        """
        shift = contacts.shift
        if shift is None:
            shift = self._find_shift(contacts, i, j, is_still)
        crosses_side = np.any(shift[:, ~self.places.pbc], axis=1)
        words = "a shift across a side of the cell that is not periodic"
        self.faults.note(crosses_side, words, values=shift.astype(float), mend="Compare pbc")
        return shift

    def _take_overlaps(self, contacts: Contacts, pairs: _Pairs) -> _Pairs:
        """Return the pairs (m,) with the overlaps of the source in place of those of places and
        radii.

        Notes, as faults, overlaps that are far from those of places and radii. Warns as
        :func:`_compare_overlaps` does of the overlaps of the other contacts.
        """
        assert contacts.overlap is not None
        sum_of_radii = pairs.radii_i + pairs.radii_j
        deviations = np.abs(contacts.overlap - pairs.overlap)
        is_off = pairs.has_overlap & (deviations > _REACH * sum_of_radii)
        self.faults.note(
            is_off,
            "an overlap that is not that of places and radii",
            values=contacts.overlap,
            unit="m",
            mend="Compare the units",
        )
        rows = ~self.faults.is_bad[self.faults.rows]
        _compare_overlaps(contacts.select(rows), self.places.balls, pairs.select(rows))
        has_overlap = np.ones(len(contacts), bool)
        return replace(pairs, overlap=contacts.overlap, has_overlap=has_overlap)

    def _note_arms(self, contacts: Contacts, pairs: _Pairs) -> None:
        """Note, as faults, contacts between balls that move for which the source has arms whose sum
        is not the distance of the centres.
        """
        if contacts.arm_i is None and contacts.arm_j is None:
            return
        sums_of_arms = np.zeros(len(contacts))
        for name, default in pairs.arms.items():
            values = getattr(contacts, name)
            sums_of_arms += default if values is None else values
        places = self.places
        vector = places.positions[pairs.j] - places.positions[pairs.i] + pairs.shift @ places.cell
        is_still = places.balls.fixed[pairs.i] | places.balls.fixed[pairs.j]
        self.faults.note(
            ~(span_distance(sums_of_arms, vector) | is_still),
            "arms whose sum is not the distance of the centres",
            values=sums_of_arms,
            unit="m",
            mend="Compare the units, and shift and cell with the places",
        )

    def _note_repeated(self, pairs: _Pairs) -> None:
        """Note, as faults, contacts of the same balls, images and, at walls, normals as an earlier
        one, listed from the same end or from the other.
        """
        fixed = self.places.balls.fixed
        both_move = ~(fixed[pairs.i] | fixed[pairs.j])
        _contacts, twins = find_repeated(pairs.i, pairs.j, pairs.shift, pairs.normal, both_move)
        is_repeated = np.zeros(len(pairs.i), bool)
        is_repeated[twins] = True
        self.faults.note(
            is_repeated,
            "the balls of a contact before",
            why="Every contact counts once",
            mend="List each contact from one of its ends only",
        )

    def _find_shift(self, contacts: Contacts, i: Index, j: Index, is_still: Flags) -> Index:
        """Return the whole cells (m, 3) by which balls j are displaced; zero at flat walls.

        If the source has vectors from ball i to ball j, ball j is displaced to the end of the
        vector. Otherwise ball j is displaced to where it is nearest to ball i. There is an
        exception if the source has normals: a ball may touch a body that does not move, or its own
        image, on several sides, and there ball j is displaced to where the normal leads.

        ``contacts``, ``i`` and ``j`` are those of :meth:`_find_pairs`; ``is_still`` (m,) marks
        contacts with a body that does not move.
        """
        places = self.places
        sum_of_radii = places.balls.radii[i] + places.balls.radii[j]
        is_flat = np.isinf(sum_of_radii)
        between = places.positions[j] - places.positions[i]
        between = np.where(is_flat[:, None], 0.0, between)  # a flat wall may have any place
        shift = np.zeros((len(sum_of_radii), 3), np.intp)
        # with a normal, the place of a body that does not move says nothing about the contact
        is_anywhere = is_still if contacts.normal is not None else is_flat
        if contacts.vector is not None:
            shift[:, places.axes] = self._find_steps(contacts, between, sum_of_radii, is_anywhere)
        elif places.axes.size:
            with_itself = i == j
            steps = self._find_nearest_steps(between, sum_of_radii, is_anywhere, with_itself)
            if contacts.normal is not None:
                follows_normal = (is_still & ~is_flat) | with_itself
                # from ball j in the cell to where the normal leads from ball i
                gaps = np.zeros_like(between)
                lengths = sum_of_radii[follows_normal, None]
                gaps[follows_normal] = lengths * contacts.normal[follows_normal]
                gaps[follows_normal] -= between[follows_normal]
                steps_along_normals = self._round_steps(gaps @ np.linalg.pinv(places.periods))
                steps[follows_normal] = steps_along_normals[follows_normal]
            shift[:, places.axes] = steps
        shift[is_flat] = 0
        return shift

    def _find_steps(
        self, contacts: Contacts, between: Array, sum_of_radii: Array, is_anywhere: Flags
    ) -> Index:
        """Return the whole cells (m, p), along the p periods, by which balls j are displaced, from
        the vectors of contacts; note, as a fault, a vector that leads to no image of ball j.

        ``between`` (m, 3) leads from ball i to ball j in the cell, m; ``sum_of_radii`` is (m,), m;
        ``is_anywhere`` (m,) marks contacts with a body whose place says nothing about the contact.
        """
        assert contacts.vector is not None
        periods = self.places.periods
        to_cells = np.linalg.pinv(periods)  # (3, p), from lengths to numbers of cells
        steps = self._round_steps((contacts.vector - between) @ to_cells)
        deviations = np.linalg.norm(between + steps @ periods - contacts.vector, axis=1)
        is_off = ~is_anywhere & (deviations > _VECTOR_TOLERANCE * sum_of_radii)
        # by how much the vectors would miss an image of ball j if they had the opposite signs
        reversed_gaps = between + contacts.vector
        reversed_gaps -= self._round_steps(reversed_gaps @ to_cells) @ periods
        fits_reversed = np.linalg.norm(reversed_gaps, axis=1) <= _VECTOR_TOLERANCE * sum_of_radii
        if np.all(fits_reversed[is_off]):
            mend = "Turn the signs: the vector of a dump (dx, dy, dz) leads from ball j to ball i"
        else:
            mend = "Are both files of one time step?"
        words = "a vector that does not lead from ball to ball in this cell, off by a distance"
        self.faults.note(is_off, words, values=deviations, unit="m", mend=mend)
        return steps

    def _find_nearest_steps(
        self, between: Array, sum_of_radii: Array, is_anywhere: Flags, with_itself: Flags
    ) -> Index:
        """Return the whole cells (m, p), along the p periods, by which balls j are displaced to
        where they are nearest to balls i; note, as a fault, balls that touch at more than one of
        their images.

        The arguments are those of :meth:`_find_steps`; ``with_itself`` (m,) marks contacts of a
        ball with its own image.
        """
        # in an oblique cell the nearest image may be many cells away from the one that rounding
        # finds: the images are sought along short periods of the same lattice
        multiples = _find_short_periods(self.places.periods)
        periods = multiples @ self.places.periods
        n_periods = len(periods)
        rounded_steps = -self._round_steps(between @ np.linalg.pinv(periods))
        # (3^p, p): the nearest image may still be beside the one that rounding finds
        axis_steps = [[-1, 0, 1]] * n_periods
        steps = np.stack(np.meshgrid(*axis_steps, indexing="ij"), axis=-1).reshape(-1, n_periods)
        # the distances of the nearest, second and third nearest image so far
        nearest_distance = np.full(len(between), np.inf)
        second_distance = np.full(len(between), np.inf)
        third_distance = np.full(len(between), np.inf)
        nearest_steps = rounded_steps.copy()
        for step in steps:
            candidate = rounded_steps + step
            distance = np.linalg.norm(between + candidate @ periods, axis=1)
            # a ball does not touch itself without a displacement
            distance[with_itself & np.all(candidate == 0, axis=1)] = np.inf
            is_nearer = distance < nearest_distance
            nearest_steps[is_nearer] = candidate[is_nearer]
            third_distance = np.minimum(third_distance, np.maximum(second_distance, distance))
            second_distance = np.minimum(second_distance, np.maximum(nearest_distance, distance))
            nearest_distance = np.minimum(nearest_distance, distance)
        # a ball has two equally near images of itself, which are one contact
        next_distance = np.where(with_itself, third_distance, second_distance)
        self.faults.note(
            ~is_anywhere & (next_distance < sum_of_radii),
            "balls that touch at more than one place",
            why="The cell is so small that one contact is not the only one of its balls",
            mend="Give the shift of each contact",
        )
        return np.asarray(nearest_steps @ multiples, np.intp)

    def _round_steps(self, steps: Array) -> Index:
        """Return the whole numbers of cells (m, p) nearest to ``steps`` (m, p); note, as a fault,
        balls that are too many cells apart, with 0 in their place.
        """
        is_near = np.abs(steps) <= MOST_STEPS  # False for nan
        words = f"balls more than {MOST_STEPS} cells apart"
        self.faults.note(~np.all(is_near, axis=1), words, mend="Compare cell and places")
        return np.asarray(np.rint(np.where(is_near, steps, 0.0)), np.intp)

    def _split_forces(self, contacts: Contacts, pairs: _Pairs) -> tuple[Array | None, Array | None]:
        """Return the normal forces (m,), N, and the tangential forces (m, 3), N, of ``contacts``:
        those of the source, or else the parts of its force vectors. Each is None if the source has
        neither.

        Notes as faults: force vectors that pull and stand for normal forces, unless contacts are
        adhesive; tangential forces of
        the source that are not across the normals; and contacts for which neither force nor overlap
        is known.
        """
        normal_force = contacts.normal_force
        tangential_force = contacts.tangential_force
        if contacts.force is not None:
            normal_parts = np.einsum("ca,ca->c", contacts.force, pairs.normal)
            if normal_force is None:
                mend = ""
                if len(normal_parts) and np.max(normal_parts) <= 0.0:  # no contact presses
                    mend = "Turn the signs: they are those of the forces on the other ball"
                note_pulling(self.faults, normal_parts, self.adhesive, mend)
                normal_force = normal_parts
            if tangential_force is None:
                tangential_force = contacts.force - normal_parts[:, None] * pairs.normal
        if contacts.tangential_force is not None:
            known_force = 0.0 if normal_force is None else normal_force
            is_across = are_across(contacts.tangential_force, pairs.normal, known_force)
            self.faults.note(
                ~is_across,
                "a tangential_force that is not across the normal",
                values=contacts.tangential_force,
                unit="N",
                mend="Leave the normal force out of it",
            )
        if normal_force is None and contacts.overlap is None:
            words = "a body that does not move, and no force"
            self.faults.note(~pairs.has_overlap, words, mend="Give normal_force")
        return normal_force, tangential_force


def _find_short_periods(periods: Array) -> Index:
    """Return whole multiples (p, p) of the ``periods`` (p, 3), m, that add up to short periods of
    the same lattice, one in each row; the unit matrix if the periods are short already.

    Of two periods the multiple of one that makes the other shortest is subtracted from the other,
    as in Gauss's reduction of quadratic forms, until none becomes shorter.
    """
    n_periods = len(periods)
    multiples = np.eye(n_periods, dtype=np.intp)
    pairs = list(itertools.permutations(range(n_periods), 2))
    has_changed = True
    while has_changed:
        has_changed = False
        for row, other in pairs:
            vectors = multiples @ periods
            size = np.linalg.norm(vectors[other])
            count = np.rint(vectors[row] / size @ vectors[other] / size)
            shorter = np.linalg.norm(vectors[row] - count * vectors[other])
            # images more cells away than MOST_STEPS are refused in any case
            is_countable = abs(count) <= MOST_STEPS
            # a period that is shorter by rounding alone would be exchanged for ever
            is_shorter = shorter < (1.0 - _LEAST_SHORTENING) * np.linalg.norm(vectors[row])
            if is_countable and is_shorter:
                multiples[row] -= int(count) * multiples[other]
                has_changed = True
    return multiples


@dataclass(frozen=True)
class _Joined:
    """Contacts (m,) that have no fault, with the balls that they join.

    Attributes
    ----------
    contacts : the contacts as the source has them.
    pairs : the pairs of balls.
    normal_force : (m,) N; None if it is not known.
    tangential_force : (m, 3) N; None if it is not known.
    is_normal : whether the source has force vectors that are along the normals but for rounding:
        the tangential forces are then this rounding alone. Some programs write the normal part as
        force vectors, and list tangential forces elsewhere.
    """

    contacts: Contacts
    pairs: _Pairs
    normal_force: Array | None
    tangential_force: Array | None
    is_normal: bool

    def complete(self, balls: Balls, completion: Completion) -> dict[str, Any]:
        """Return the fields of the contacts of the network, by name, each (m,) or (m, 3), SI.

        Where stiffnesses follow from Hertz's law, contacts without a force that presses are open:
        they are left out. Warns if the forces are those of the source, and the balls of such
        contacts overlap (:func:`_warn_of_open`). Raises InputError as :meth:`_find_springs` does.
        """
        contacts = self.contacts
        pairs = self.pairs
        force, stiffness, shear = self._find_springs(balls, completion)
        torsion, bending = self._find_rolling_springs(shear)
        fields_of_contacts: dict[str, Any] = {
            "i": pairs.i,
            "j": pairs.j,
            "shift": pairs.shift,
            "normal": pairs.normal,
            "normal_force": force,
            "normal_stiffness": stiffness,
            "shear_stiffness": shear,
            "torsion_stiffness": torsion,
            "bending_stiffness": bending,
        }
        for name, default in pairs.arms.items():
            values = getattr(contacts, name)
            fields_of_contacts[name] = default if values is None else values
        if self.tangential_force is not None:
            fields_of_contacts["tangential_force"] = self.tangential_force
        torque = self._find_torque()
        if torque is not None:
            fields_of_contacts["contact_torque"] = torque
        if contacts.normal_stiffness is None:
            assert completion.material is not None  # _find_springs has required a material
            if self.normal_force is not None:
                coefficient = pairs.find_coefficient(completion.material)
                _warn_of_open(contacts, balls, pairs, coefficient, force)
            return _leave_out(fields_of_contacts, force <= 0.0)
        return fields_of_contacts

    def _find_springs(self, balls: Balls, completion: Completion) -> tuple[Array, Array, Array]:
        """Return the normal forces, N, the normal stiffnesses and the shear stiffnesses, N/m, each
        (m,).

        Forces and stiffnesses that the source does not have follow from the material of the balls
        by the laws of Hertz and Mindlin. Shear stiffnesses that the source does not have are zero
        without friction. InputError if a material is needed and is not given, or if the overlaps
        from which forces follow have large errors (:func:`_judge_errors`).
        """
        contacts = self.contacts
        pairs = self.pairs
        force = self.normal_force
        stiffness = contacts.normal_stiffness
        shear = contacts.shear_stiffness
        material = completion.material
        self._require_springs(completion)
        if force is None or stiffness is None:
            assert material is not None
            coefficient = pairs.find_coefficient(material)
            if force is None:
                find_force = partial(_find_force_of_overlap, coefficient, pairs.overlap)
                force = find_force()
                _judge_errors(contacts, balls, pairs, find_force)
            if stiffness is None:
                unit_law = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
                overlap = unit_law.overlap(force / coefficient)
                stiffness = coefficient * unit_law.stiffness(overlap)
        if shear is None:
            ratio = 0.0
            if completion.friction and material is not None:
                ratio = material.mindlin_ratio
            shear = stiffness * ratio
        return force, stiffness, shear

    def _require_springs(self, completion: Completion) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the source lacks forces or
        stiffnesses, and there is no material from which they follow.
        """
        contacts = self.contacts
        missing_names = ["normal_force"] if self.normal_force is None else []
        names = ["normal_stiffness"]
        if completion.friction:
            names.append("shear_stiffness")
        missing_names += [name for name in names if getattr(contacts, name) is None]
        if not missing_names or completion.material is not None:
            return
        mend = "Give the material of the balls, from which they follow, or the columns"
        if missing_names == ["shear_stiffness"]:
            mend = "Give the column, the material of the balls, or friction=False"
        problem = f"{contacts.name} has no {', '.join(missing_names)}, and no material is given"
        raise InputError(problem, mend=mend)

    def _find_rolling_springs(self, shear: Array) -> tuple[Array, Array]:
        """Return the torsion and the bending stiffnesses, each (m,), N m; ``shear`` (m,) are the
        shear stiffnesses, N/m.

        Those that the source does not have follow from its coefficients of twisting and rolling,
        see :class:`~granphon.networks.sources.Contacts`; without these they are zero.
        """
        contacts = self.contacts
        radii = self.pairs.reduced_radii
        torsion = contacts.torsion_stiffness
        bending = contacts.bending_stiffness
        if torsion is None:
            torsion = np.zeros(len(radii))
            if contacts.twisting == "marshall":
                # Marshall's law: half the shear coefficient times the square of the radius of the
                # contact spot. For Mindlin's law, whose shear stiffness is proportional to that
                # radius, LAMMPS takes as coefficient the stiffness over the radius.
                spot_radii = np.sqrt(radii * np.maximum(self.pairs.overlap, 0.0))  # m
                is_constant = contacts.shear_stiffness is not None
                torsion = 0.5 * shear * (spot_radii**2 if is_constant else spot_radii)
            elif contacts.twisting is not None:
                torsion = np.full(len(radii), float(contacts.twisting))
        if bending is None and contacts.rolling == "epsd2":
            bending = shear * radii**2 * self._find_roll_ratios()
        elif bending is None:
            bending = float(contacts.rolling or 0.0) * radii**2
        return np.asarray(torsion), np.asarray(bending)

    def _find_roll_ratios(self) -> Array:
        """Return the rotations (m,) that LIGGGHTS counts as rolling, over those of balls: one
        between balls, and at flat walls the arm over the distance of the centre from the wall, or
        one where no arm is known.
        """
        pairs = self.pairs
        ratios = np.ones(len(pairs.i))
        arms = self.contacts.arm_i
        if arms is not None:
            is_flat = np.isinf(pairs.radii_j)
            distances = 2.0 * arms - pairs.radii_i  # the arm ends amid the overlap
            np.divide(arms, distances, out=ratios, where=is_flat & (distances > 0.0))
        return ratios

    def _find_torque(self) -> Array | None:
        """Return the static torques (m, 3) of rolling and twist, N m, with which balls i act on
        balls j; None if the source has none.
        """
        contacts = self.contacts
        normal = self.pairs.normal
        if contacts.contact_torque is not None:
            return contacts.contact_torque
        if contacts.rolling_force is None and contacts.twisting_torque is None:
            return None
        torque = np.zeros(normal.shape)
        if contacts.rolling_force is not None:
            radii = self.pairs.reduced_radii[:, None]
            torque -= radii * np.cross(normal, contacts.rolling_force)
        if contacts.twisting_torque is not None:
            torque += contacts.twisting_torque[:, None] * normal
        return torque


def _is_rounding(tangential_force: Array | None, normal_force: Array | None) -> bool:
    """Whether the tangential forces (m, 3), N, are so small beside the normal forces (m,), N, that
    they are rounding; false if either are not known.
    """
    if tangential_force is None or normal_force is None:
        return False
    sizes = np.linalg.norm(tangential_force, axis=1)
    return bool(np.all(sizes <= _ACROSS_TOLERANCE * np.abs(normal_force)))


def _warn_of_missing_forces(contacts: Contacts) -> None:
    """Warn that the list of ``contacts`` has no tangential forces, though static forces act."""
    fault = f"{contacts.name} has no tangential forces, and its normal ones act (prestress)"
    why = (
        "Contacts that resist slip bear both, of one order: without them a packing at"
        " rest may seem unstable"
    )
    mend = (
        "Give tx, ty, tz (p1, p2, p3 of compute pair/local) or tangential_x,"
        " tangential_y, tangential_z"
    )
    warn_caller(message(fault, why, mend), InconsistencyWarning)


def _find_force_of_overlap(coefficient: Array, overlap: Array, error: Array | float = 0.0) -> Array:
    """Return the forces (n_c,), N, of Hertz's law with this ``coefficient`` (n_c,), N/m^(3/2), at
    the ``overlap`` (n_c,) plus an ``error`` of it, (n_c,) or a number, m.
    """
    return np.asarray(coefficient * HertzLaw(1.0).force(overlap + error))


def _judge_errors(
    contacts: Contacts, balls: Balls, pairs: _Pairs, find_force: Callable[..., Array]
) -> None:
    """Raise InputError if the standard errors of forces that follow from overlaps add up to more
    than ``_MOST_ERROR`` of the sum of the forces, over all contacts.

    ``find_force(error)`` returns the forces (n_c,), N, at the overlaps plus an error (n_c,), m. The
    errors come from the rounding of the overlaps of the source, or else of its places and radii.
    Smaller errors have a warning of their own (:mod:`granphon.networks.consistency`).
    """
    rounded_things = f"places of {balls.name}" if contacts.overlap is None else "the overlaps"
    _greatest_errors, errors = _find_errors(contacts, balls, pairs)
    if not errors.size:
        return
    force_error = float(np.sum(find_force(errors) - find_force(-errors))) / 2.0
    total_force = float(np.sum(find_force()))
    if force_error <= _MOST_ERROR * total_force:  # both may be zero, of balls that just touch
        return
    error_share = min(force_error / total_force, 1.0) if total_force else 1.0
    raise InputError(
        f"{contacts.name} has no forces, and those of the overlaps are off by {error_share:.0%}, as"
        f" {rounded_things} are rounded: {float(np.max(errors)):.2g} m in an overlap",
        "An overlap is a small difference of places",
        "Write places with more digits (in LAMMPS: dump_modify 1 format float %.16g), or give the"
        " forces",
    )


def _find_errors(contacts: Contacts, balls: Balls, pairs: _Pairs) -> tuple[Array, Array]:
    """Return the greatest and the standard errors, each (n_c,), m, that rounding leaves in the
    overlaps of ``pairs``: those of the source, or else those of places and radii.
    """
    if contacts.overlap is None:
        return _find_errors_of_places(balls, pairs)
    # rounding errors are uniform up to the greatest one: the standard error is that over root 3
    greatest_errors = find_rounding(contacts.overlap)
    return greatest_errors, greatest_errors / math.sqrt(3.0)


def _find_errors_of_places(balls: Balls, pairs: _Pairs) -> tuple[Array, Array]:
    """Return the greatest and the standard errors, each (n_c,), m, that the rounding of places and
    radii leaves in the overlaps that follow from these.
    """
    return find_errors_of_overlaps(
        balls.rounding, balls.radius_rounding, pairs.i, pairs.j, pairs.normal
    )


def _compare_overlaps(contacts: Contacts, balls: Balls, pairs: _Pairs) -> None:
    """Warn if the overlaps of the source are not those of places and radii, ``pairs.overlap``.

    First the median of the ratio of both is compared with one, to 5 %. Pairs that are apart, or
    whose overlap is uncertain by that much from rounding alone, do not count. If the median is near
    to one, or no pair counts, single overlaps are compared (:func:`_warn_of_single_overlaps`).
    """
    assert contacts.overlap is not None
    greatest_errors, _standard_errors = _find_errors_of_places(balls, pairs)
    is_clear = pairs.has_overlap & (pairs.overlap * _LEAST_DEVIATION > greatest_errors)
    if np.any(is_clear):
        ratio = float(np.median(contacts.overlap[is_clear] / pairs.overlap[is_clear]))
        if abs(ratio - 1.0) >= _LEAST_DEVIATION:
            fault = f"{contacts.name}: the overlaps are {ratio:.4g} times those of places and radii"
            mend = "Compare their units, and those of places and radii"
            warn_caller(message(fault, mend=mend), InconsistencyWarning)
            return
    _warn_of_single_overlaps(contacts, pairs, greatest_errors)


def _warn_of_single_overlaps(contacts: Contacts, pairs: _Pairs, greatest_errors: Array) -> None:
    """Warn of overlaps of the source that are more than ten times those of places and radii, or
    less than a tenth.

    Rounding may leave errors up to ``greatest_errors`` (n_c,), m, in the overlaps of places and
    radii: a contact is told only if no such error explains the factor. A contact whose overlaps are
    both small beside the others is not told either.
    """
    assert contacts.overlap is not None
    overlap = np.maximum(contacts.overlap, 0.0)
    # the overlaps of places and radii, with the greatest errors
    least_overlap = np.maximum(pairs.overlap - greatest_errors, 0.0)
    greatest_overlap = np.maximum(pairs.overlap + greatest_errors, 0.0)
    is_too_large = overlap > _MOST_FACTOR * greatest_overlap
    is_far = is_too_large | (least_overlap > _MOST_FACTOR * overlap)
    is_large = np.maximum(overlap, least_overlap) > _find_least_size(overlap)
    odd_rows = np.flatnonzero(pairs.has_overlap & is_far & is_large)
    if not odd_rows.size:
        return
    shown = [
        f"{contacts.describe(row)}, {contacts.overlap[row]:.3g} m where places have"
        f" {pairs.overlap[row]:.3g} m"
        for row in odd_rows[:MOST_NAMED].tolist()
    ]
    subject = counted(odd_rows.size, "overlap is", "overlaps are")
    fault = (
        f"{contacts.name}: {subject} more than ten times that of places and radii, or less than a"
        f" tenth: {'; '.join(shown)}"
    )
    warn_caller(message(fault, "The overlaps count"), InconsistencyWarning)


def _warn_of_open(
    contacts: Contacts, balls: Balls, pairs: _Pairs, coefficient: Array, force: Array
) -> None:
    """Warn of contacts whose ``force`` (n_c,), N, is zero, though their balls overlap.

    Such a contact is told if Hertz's law with the ``coefficient`` (n_c,), N/m^(3/2), gives a force
    that is not small beside the forces of other contacts, even at the least overlap that rounding
    allows.
    """
    greatest_errors, _standard_errors = _find_errors(contacts, balls, pairs)
    force_of_law = _find_force_of_overlap(coefficient, pairs.overlap, -greatest_errors)
    is_large = force_of_law > _find_least_size(np.abs(force))
    odd_rows = np.flatnonzero(pairs.has_overlap & (force == 0.0) & is_large)
    if not odd_rows.size:
        return
    shown = [
        f"{contacts.describe(row)}, where the overlap makes {force_of_law[row]:.3g} N"
        for row in odd_rows[:MOST_NAMED].tolist()
    ]
    subject = counted(odd_rows.size, "contact has", "contacts have")
    fault = f"{contacts.name}: {subject} no force, though the balls overlap: {'; '.join(shown)}"
    why = "Such contacts are left out as open ones"
    warn_caller(message(fault, why, "Compare the column of forces"), InconsistencyWarning)


def _find_least_size(sizes: Array) -> float:
    """Return the size above which a single contact is told: the part :data:`_LEAST_SHARE` of the
    mean of the ``sizes`` (n_c,) of all contacts; zero without a contact.
    """
    return _LEAST_SHARE * float(np.mean(sizes)) if sizes.size else 0.0


def _leave_out(fields_of_contacts: Mapping[str, Any], is_open: Flags) -> dict[str, Any]:
    """Return the ``fields_of_contacts``, by name, without the contacts that ``is_open`` (n_c,)
    marks.
    """
    return {name: values[~is_open] for name, values in fields_of_contacts.items()}


def _concatenate(lists: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the fields of the contacts of several ``lists``, by name, joined in the order of the
    lists; a field that one of the lists lacks is left out.
    """
    shared_names = set.intersection(*(set(contacts) for contacts in lists))
    names = [name for name in lists[0] if name in shared_names]
    return {name: np.concatenate([contacts[name] for contacts in lists]) for name in names}
