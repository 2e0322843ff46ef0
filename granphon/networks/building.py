"""Networks of balls and contacts of which a program of discrete elements has left a part: the rest
follows from it.

Stiffnesses follow from force and material by Hertz and Mindlin, masses from the density, inertias
are those of solid spheres, shifts lead to the nearest image, and normals lie along the line of the
centres.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from granphon.balls.ball import BALL_LIMITS, WRONG_UNIT, Ball
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import HertzLaw, harmonic_diameter
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, brief, message
from granphon.base.text import counted
from granphon.base.validation import real_array, require, truth, whole_number

#: greatest number in SI, and the inverse of the least one: products of a few of them stay within
#: the range of floats
LARGEST = 1e60
#: greatest number of cells between two balls
MOST_STEPS = 1_000_000_000
#: greatest gap or overlap of two balls, over the sum of their radii, at which they may be in
#: contact
_REACH = 0.25
#: greatest error of a vector between two balls, over the sum of their radii, that is put down to
#: rounding in a file
_ROUNDED = 1e-2
#: difference of z, over the largest radius, up to which balls are in one plane: the rounding in a
#: file
_LEVEL = 1e-9
#: greatest factor between the force of a source and that of Hertz's law at the overlap of the two
#: balls
_MOST_FACTOR = 10.0
#: least force, over the mean, that is compared with Hertz's law: weaker contacts may not have come
#: to rest
_LEAST_COMPARED = 1e-3
#: least and greatest number of significant digits with which a program writes numbers
_DIGITS = (6, 15)
#: number of different values of fewer digits from which on the values are rounded, not chosen by
#: hand
_CHOSEN = 100
#: greatest relative error of a number that is read from a text and converted into SI
_EXACT = 1e-14
#: standard error of the forces that follow from overlaps, over the forces, above which there is a
#: warning. Frequencies have a sixth of the error of forces, 0.1 %
_LEAST_WARNED_ERROR = 6e-3
#: the same above which forces are refused: frequencies are off by 1 %, as far as elastic constants
#: are known
_MOST_ERROR = 6e-2
#: least difference of a ratio from one with a warning: of all forces to Hertz's, of masses to those
#: of the density. A ratio of 1.05 has a warning, however it is rounded
_LEAST_WARNED_RATIO = 0.049
#: greatest scatter of a ratio that is the same for all contacts: the rounding in a file, and how
#: far balls are from rest
_SAME = 1e-4
#: the largest file of balls or contacts that is read, bytes: that of some millions of contacts
MOST_BYTES = 4_000_000_000


@dataclass(frozen=True)
class Balls:
    """The balls of a source, in SI; None for fields that the source does not have.

    ``name`` is the name of the source in messages. Positions are (n, 1), (n, 2) or (n, 3); the
    other fields are (n,). ``labels`` are whole numbers that name the balls. ``rounding``, of the
    shape of the positions, and ``radius_rounding`` (n,) are the greatest errors that the digits of
    the source leave in positions and radii, m.
    """

    name: str
    positions: Array
    radii: Array
    masses: Array | None = None
    inertias: Array | None = None
    labels: Index | None = None
    rounding: Array | None = None
    radius_rounding: Array | None = None
    kinds: tuple[str, ...] | None = None

    def require(self, is_fine: Flags, name: str, values: Array) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the ``values`` (n,) or (n, d), m,
        of all balls are fine, (n,); the message names the first ball whose value is not, and calls
        the value ``name``.
        """
        if np.all(is_fine):
            return
        ball = int(np.argmin(is_fine))
        value = values[ball].tolist()
        number = ball if self.labels is None else int(self.labels[ball])
        why = ""
        if value == math.inf:
            why = "Only a body that does not move may have a radius of inf"
        raise InputError(f"{self.name}: ball {number} has the {name} {value} m", why)

    def find_errors(self, i: Index, j: Index, normal: Array) -> tuple[Array, Array]:
        """Return the greatest and the standard error that rounding leaves in the overlaps of balls
        i and j, each (n_c,), m; ``normal`` is (n_c, 3).
        """
        n_axes = self.positions.shape[1]
        position_errors = self.rounding
        if position_errors is None:
            position_errors = np.zeros_like(self.positions)
        radius_errors = self.radius_rounding
        if radius_errors is None:
            radius_errors = np.zeros_like(self.radii)
        weights = np.abs(normal[:, :n_axes])  # of the error along each axis
        greatest = np.einsum("ca,ca->c", weights, position_errors[i] + position_errors[j])
        greatest = greatest + radius_errors[i] + radius_errors[j]
        squares = np.einsum(
            "ca,ca->c", weights**2, position_errors[i] ** 2 + position_errors[j] ** 2
        )
        squares = squares + radius_errors[i] ** 2 + radius_errors[j] ** 2
        # errors of rounding are even up to the greatest: their variance is a third of its square
        return greatest, np.sqrt(squares / 3.0)


@dataclass(frozen=True)
class Contacts:
    """The contacts of a source, in SI; None for fields that the source does not have.

    ``i`` and ``j`` are labels of balls, or their indices where balls have no labels. ``normal``,
    ``vector`` from the centre of ball i to that of ball j, ``tangential_force``, with which ball i
    acts on ball j, and ``shift``, whole cells by which ball j is displaced, are (n_c, 3); the other
    fields are (n_c,). Forces that press are positive.
    """

    name: str
    i: Index
    j: Index
    shift: Index | None = None
    vector: Array | None = None
    normal: Array | None = None
    tangential_force: Array | None = None
    normal_force: Array | None = None
    normal_stiffness: Array | None = None
    shear_stiffness: Array | None = None
    torsion_stiffness: Array | None = None
    bending_stiffness: Array | None = None
    arm_i: Array | None = None
    arm_j: Array | None = None

    def refuse(self, bad: Flags, wrong: str, why: str = "", mend: str = "") -> None:
        """Raise :class:`~granphon.base.errors.InputError` if any contact is ``bad``; the message
        names the first one.
        """
        if np.any(bad):
            raise InputError(self.describe(bad, wrong), why, mend)

    def describe(self, bad: Flags, wrong: str) -> str:
        """Return words for the first contact that is ``bad`` (n_c,), with what is ``wrong`` with it
        and the number of bad contacts.
        """
        first = int(np.flatnonzero(bad)[0])
        n_bad = int(np.count_nonzero(bad))
        total = f" ({n_bad} in all)" if n_bad > 1 else ""
        return (
            f"{self.name}: contact {first}, of balls {self.i[first]} and {self.j[first]},"
            f" {wrong}{total}"
        )

    def require_pushing(self, force: Array, adhesive: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if a force (n_c,), N, is not finite, or
        pulls where contacts are not ``adhesive``.
        """
        is_odd = ~np.isfinite(force)
        if not adhesive:
            is_odd |= force < 0.0
        self.refuse(
            is_odd,
            f"has the force {_first(force, is_odd):.6g} N",
            "Forces that pull, or are not finite, are not of elastic balls",
            "Forces that press count as positive",
        )

    def find_steps(self, between: Array, periods: Array, touch: Array, still: Flags) -> Index:
        """Return the whole cells (n_c, p) by which balls j are displaced, from the vectors of
        contacts; InputError for a vector that leads to no image of ball j, unless the contact is
        ``still``, and for balls too many cells apart.

        ``between`` (n_c, 3) leads from ball i to ball j in the cell, m; ``periods`` (p, 3) are the
        periodic vectors of the cell, m; ``touch`` (n_c,) is the sum of the radii, m; contacts that
        are ``still`` (n_c,) have a body that does not move, and may lie anywhere.
        """
        assert self.vector is not None
        to_cells = np.linalg.pinv(periods)  # (3, p), from lengths to numbers of cells
        steps = _round_steps((self.vector - between) @ to_cells)
        deviations = np.linalg.norm(between + steps @ periods - self.vector, axis=1)
        is_off = ~still & (deviations > _ROUNDED * touch)
        mend = "Are both files of one time step?"
        # the vectors from ball i to ball j less those of the contacts with the opposite sign
        reversed_gaps = between + self.vector
        reversed_gaps -= _round_steps(reversed_gaps @ to_cells) @ periods
        fits_reversed = np.linalg.norm(reversed_gaps, axis=1) <= _ROUNDED * touch
        if np.all(fits_reversed[~still]):
            mend = "Turn the signs: the vector of a dump (dx, dy, dz) leads from ball j to ball i"
        why = "Its vector does not lead from one to the other in this cell"
        self.refuse(is_off, "is not where its balls are", why, mend)
        return steps

    def find_nearest_steps(
        self, between: Array, periods: Array, touch: Array, still: Flags, with_itself: Flags
    ) -> Index:
        """Return the whole cells (n_c, p) by which balls j are displaced to where they are nearest
        to balls i; InputError for balls that touch at more than one of their images, unless the
        contact is ``still``, and for balls too many cells apart.

        The arguments are those of :meth:`find_steps`; contacts ``with_itself`` (n_c,) join a ball
        with its own image.
        """
        n_periods = len(periods)
        rounded = -_round_steps(between @ np.linalg.pinv(periods))
        # (3^p, p): in a tilted cell the nearest image may be beside the one that rounding finds
        axis_steps = [[-1, 0, 1]] * n_periods
        steps = np.stack(np.meshgrid(*axis_steps, indexing="ij"), axis=-1).reshape(-1, n_periods)
        vectors = [between + (rounded + step) @ periods for step in steps]
        distances = np.stack([np.linalg.norm(vector, axis=1) for vector in vectors], axis=1)
        is_unmoved = np.all(rounded[:, None] + steps == 0, axis=2)
        distances[with_itself[:, None] & is_unmoved] = np.inf
        # a ball has two equally near images of itself, which are one contact
        rank = np.where(with_itself, 2, 1)
        second_distances = np.sort(distances, axis=1)[np.arange(len(distances)), rank]
        self.refuse(
            ~still & (second_distances < touch),
            "is not the only one of its balls",
            "The cell is so small that they touch at more than one place",
            "Give the shift of each contact",
        )
        return np.asarray(rounded + steps[np.argmin(distances, axis=1)], np.intp)


@dataclass(frozen=True)
class _Pairs:
    """Pairs of balls that touch, (n_c,): their indices, whether one of them is ``still``, their
    radii, m, the ``shift`` of ball j, (n_c, 3) cells, the ``normal`` (n_c, 3), and the overlap, m.
    """

    i: Index
    j: Index
    still: Flags
    radii_i: Array
    radii_j: Array
    shift: Index
    normal: Array
    overlap: Array

    @property
    def arms(self) -> dict[str, Array]:
        """The arms, ``arm_i`` and ``arm_j`` (n_c,), m: from the centres to the middle of the
        overlap, which is zero at bodies that do not move. The arm of a flat wall, which does not
        turn, has no meaning.
        """
        arms = {}
        for name, radii in (("arm_i", self.radii_i), ("arm_j", self.radii_j)):
            arms[name] = np.where(np.isfinite(radii), radii, 0.0) - 0.5 * self.overlap
        return arms

    def find_coefficient(self, material: Material) -> Array:
        """Return the coefficients (n_c,), N/m^(3/2), of Hertz's law between two balls, or a ball
        and a flat wall, of a ``material``.
        """
        small = np.minimum(self.radii_i, self.radii_j)
        large = np.maximum(self.radii_i, self.radii_j)
        is_flat = np.isinf(large)
        finite_large = np.where(is_flat, small, large)
        between_balls = harmonic_diameter(2.0 * small, 2.0 * finite_large)
        # the curvature of a flat wall is zero, so that the harmonic mean is twice the diameter
        diameters = np.where(is_flat, 4.0 * small, between_balls)
        # the coefficient goes as the root of the diameter: its unit is that of a diameter of 1 m
        return np.asarray(HertzLaw.between(material, 1.0).coefficient * np.sqrt(diameters))


@dataclass(frozen=True)
class Source:
    """The content of a source: balls, contacts, the cell (3, 3), m, and which of its vectors are
    periods (3,).

    The other fields are those of the network; None where the source does not have them.
    """

    balls: Balls
    contacts: Contacts
    cell: Array
    pbc: Flags
    dimension: int | None = None
    motions: str | None = None
    prestress: bool = False
    left_out: int = 0
    adhesive: bool = False
    contact_model: ContactModel | None = None
    tangential_law: str = "mindlin/force"

    def complete(
        self,
        material: Material | None,
        friction: bool,
        dimension: int | None,
        motions: str | None,
        prestress: bool | None,
    ) -> dict[str, Any]:
        """Return all fields of the network, by name, in SI units; arguments count before the fields
        of the source.

        For the arguments see :meth:`granphon.networks.network.ContactNetwork.from_table`, and for
        the warnings and errors too.
        """
        balls = self.balls
        contacts = self.contacts
        dimension = self.dimension if dimension is None else dimension
        motions = self.motions if motions is None else motions
        prestress = require("prestress", truth, self.prestress if prestress is None else prestress)
        if material is not None and not isinstance(material, Material):
            raise InputError(f"the material is {brief(material)}", mend="Give a gp.Material")
        friction = require("friction", truth, friction)
        self._require_range()
        n_axes = balls.positions.shape[1]
        positions = np.zeros((len(balls.positions), 3))
        positions[:, :n_axes] = balls.positions
        if dimension is None:
            dimension = 2 if n_axes == 3 and self._is_level() else n_axes
        dimension = whole_number("dimension", dimension, 1, 3)
        pbc = self.pbc & (np.arange(3) < dimension)
        if material is not None:
            self._judge_material(material)
        masses = self._find_masses(material)
        inertias = 0.4 * masses * balls.radii**2 if balls.inertias is None else balls.inertias
        pairs = self._find_pairs(positions, np.isinf(masses), pbc)
        force, stiffness, shear = self._find_springs(pairs, material, friction)
        resists_slip = bool(np.any(shear))
        has_tangential_forces = dimension > 1 and resists_slip
        if prestress and has_tangential_forces and contacts.tangential_force is None:
            _warn_of_missing_forces(contacts)
        model = self.contact_model
        if material is not None:
            mean_diameter = 2.0 * float(np.mean(balls.radii[np.isfinite(balls.radii)]))
            ball = Ball(material, mean_diameter)
            model = ContactModel((ball,), friction=resists_slip, own_radii=True)
        if motions is None:
            motions = next(iter(allowed_motions(dimension)))
        return {
            "cell": self.cell,
            "pbc": tuple(pbc.tolist()),
            "positions": positions,
            "radii": balls.radii,
            "masses": masses,
            "inertias": inertias,
            **self._make_contact_fields(pairs, force, stiffness, shear),
            "motions": motions,
            "dimension": dimension,
            "prestress": prestress,
            "left_out": self.left_out,
            "labels": balls.labels,
            "kinds": balls.kinds,
            "adhesive": self.adhesive,
            "contact_model": model,
            "tangential_law": self.tangential_law,
        }

    def _find_masses(self, material: Material | None) -> Array:
        """Return the masses (n,), kg: of the source, or of solid balls of the material; InputError
        without either.
        """
        balls = self.balls
        if balls.masses is not None:
            if material is not None:
                self._compare_masses(material)
            return balls.masses
        if material is None:
            problem = f"{balls.name} has no column 'mass', and no material is given"
            raise InputError(problem, mend="Give the masses, or the material of the balls")
        return np.asarray(material.density * (4.0 / 3.0 * math.pi) * balls.radii**3)

    def _make_contact_fields(
        self, pairs: _Pairs, force: Array, stiffness: Array, shear: Array
    ) -> dict[str, Any]:
        """Return the fields of the contacts of the network, (n_c,) or (n_c, 3).

        Where stiffnesses follow from Hertz's law, contacts without force are open and left out.
        """
        contacts = self.contacts
        fields: dict[str, Any] = {
            "i": pairs.i,
            "j": pairs.j,
            "shift": pairs.shift,
            "normal": pairs.normal,
            "normal_force": force,
            "normal_stiffness": stiffness,
            "shear_stiffness": shear,
        }
        zeros = np.zeros(len(force))
        defaults = {"torsion_stiffness": zeros, "bending_stiffness": zeros, **pairs.arms}
        for name, default in defaults.items():
            values = getattr(contacts, name)
            fields[name] = default if values is None else values
        if contacts.tangential_force is not None:
            fields["tangential_force"] = contacts.tangential_force
        if contacts.normal_stiffness is None:
            return _leave_out(fields, force <= 0.0)
        return fields

    def _require_range(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for positions, radii, vectors, shifts and
        periods of the cell beyond the range of numbers, and for a radius or a period of zero.
        """
        balls = self.balls
        contacts = self.contacts
        is_placed = np.all(np.abs(balls.positions) < LARGEST, axis=1)
        balls.require(is_placed, "place", balls.positions)
        is_fixed = np.zeros(len(is_placed), bool)
        if balls.masses is not None:
            is_fixed = np.isinf(balls.masses)
        is_flat_wall = is_fixed & np.isinf(balls.radii)
        is_sized = (balls.radii > 0.0) & ((balls.radii < LARGEST) | is_flat_wall)
        balls.require(is_sized, "radius", balls.radii)
        if contacts.vector is not None:
            is_far = ~np.all(np.abs(contacts.vector) < LARGEST, axis=1)
            contacts.refuse(is_far, "has a vector that is not finite, or too large")
        if contacts.shift is not None:
            is_far = ~np.all(np.abs(contacts.shift) <= MOST_STEPS, axis=1)
            contacts.refuse(is_far, f"has a shift of more than {MOST_STEPS} cells")
        lengths = np.max(np.abs(self.cell), axis=1)
        is_short = (lengths < LARGEST) & ((lengths > 1.0 / LARGEST) | ~self.pbc)
        if not np.all(is_short):
            raise InputError(f"the cell is {self.cell.tolist()} m", mend="Give vectors in m")

    def _find_pairs(self, positions: Array, is_fixed: Flags, pbc: Flags) -> _Pairs:
        """Return the pairs of balls that contacts join.

        ``positions`` are (n, 3), m; ``is_fixed`` (n,) says which balls do not move, and ``pbc``
        (3,) along which vectors of the cell the network repeats. InputError for a contact with a
        body that does not move and without a normal, for balls that move and are not near each
        other, and as of :meth:`_find_ends` and, without shifts, :meth:`_find_shift`.
        """
        balls = self.balls
        contacts = self.contacts
        i, j = self._find_ends()
        still = is_fixed[i] | is_fixed[j]
        if contacts.normal is None:
            contacts.refuse(
                still,
                "is with a body that does not move, and has no normal",
                mend="Give nx, ny and nz",
            )
        radii_i = balls.radii[i]
        radii_j = balls.radii[j]
        touch = radii_i + radii_j  # the distance at which balls touch
        shift = contacts.shift
        if shift is None:
            shift = self._find_shift(pbc, positions[j] - positions[i], touch, still, i == j)
        vector = positions[j] + shift @ self.cell - positions[i]
        distance = np.linalg.norm(vector, axis=1)
        # a body that does not move may have any place: it need not be a ball
        overlap = np.where(still, 0.0, touch - distance)
        is_far = ~still & ~(np.abs(overlap) <= _REACH * touch)
        contacts.refuse(
            is_far,
            f"joins balls that are not near each other: these, whose radii add up to"
            f" {_first(touch, is_far):.6g} m, are {_first(distance, is_far):.6g} m apart",
            mend="Compare the cell and the units",
        )
        normal = contacts.normal
        if normal is None:
            # a normal of balls in one place is nan, and is refused by the network
            with np.errstate(invalid="ignore", divide="ignore"):
                normal = vector / distance[:, None]
        return _Pairs(i, j, still, radii_i, radii_j, shift, normal, overlap)

    def _find_shift(
        self, pbc: Flags, between: Array, touch: Array, still: Flags, with_itself: Flags
    ) -> Index:
        """Return the whole cells (n_c, 3) by which balls j are displaced: as the vectors of the
        source say; without vectors to where they are nearest, or, of contacts that are ``still`` or
        ``with_itself`` and have normals, to where these lead; zero at flat walls.

        The arguments are those of :meth:`Contacts.find_nearest_steps`; ``pbc`` (3,) says which
        vectors of the cell are periods. InputError for periods that are not independent, with
        vectors as of :meth:`Contacts.find_steps`, and without them as of
        :meth:`Contacts.find_nearest_steps`.
        """
        contacts = self.contacts
        is_flat = np.isinf(touch)
        between = np.where(is_flat[:, None], 0.0, between)  # a flat wall may have any place
        shift = np.zeros((len(touch), 3), np.intp)
        axes = np.flatnonzero(pbc)
        periods = self.cell[axes]
        if axes.size and np.linalg.matrix_rank(periods) < axes.size:
            problem = "the periodic vectors of the cell are not independent of each other"
            raise InputError(problem, mend="Give other vectors, or name fewer as periodic")
        if contacts.vector is not None:
            shift[:, axes] = contacts.find_steps(between, periods, touch, still)
        elif axes.size:
            steps = contacts.find_nearest_steps(between, periods, touch, still, with_itself)
            if contacts.normal is not None:
                # a ball may touch one that does not move, or its own image, on several sides
                is_led = (still & ~is_flat) | with_itself
                vectors = touch[is_led, None] * contacts.normal[is_led]
                to_cells = np.linalg.pinv(periods)
                steps[is_led] = _round_steps((vectors - between[is_led]) @ to_cells)
            shift[:, axes] = steps
        shift[is_flat] = 0
        return shift

    def _find_ends(self) -> tuple[Index, Index]:
        """Return the indices, each (n_c,), of the two balls of each contact, by their labels;
        InputError for a label that two balls have, or none.
        """
        balls = self.balls
        n_balls = len(balls.positions)
        labels = np.arange(n_balls) if balls.labels is None else balls.labels
        order = np.argsort(labels, kind="stable")
        sorted_labels = labels[order]
        repeated = sorted_labels[:-1][np.diff(sorted_labels) == 0]
        if repeated.size:
            problem = f"{balls.name} has two balls with the id {repeated[0]}"
            raise InputError(problem, mend="Give each an id of its own")
        why = f"There, {counted(n_balls, 'ball has an id', 'balls have ids')}"
        if balls.labels is None:
            why = f"There, balls are 0 to {n_balls - 1}"
        problem = f"names a ball that is not among those of {balls.name}"
        ends = list[Index]()
        for end_labels in (self.contacts.i, self.contacts.j):
            # the place of each label among the sorted ones, or of one beside it
            places = np.minimum(np.searchsorted(sorted_labels, end_labels), max(n_balls - 1, 0))
            is_missing = np.ones(len(end_labels), bool)
            if n_balls:
                is_missing = sorted_labels[places] != end_labels
            self.contacts.refuse(is_missing, problem, why)
            ends.append(np.asarray(order[places], np.intp))
        return ends[0], ends[1]

    def _find_springs(
        self, pairs: _Pairs, material: Material | None, friction: bool
    ) -> tuple[Array, Array, Array]:
        """Return the normal force, N, the normal and the shear stiffness, N/m, each (n_c,): of the
        source, or of balls of the ``material`` by the laws of Hertz and Mindlin.

        A shear stiffness that the source does not have is zero without ``friction``. InputError for
        forces that pull where contacts are not adhesive, and where a material, or the force of a
        contact with a body that does not move, is needed and lacks. Forces of overlaps are judged
        by :func:`_judge_errors`, which refuses or warns; forces of the source from which
        stiffnesses follow are compared by :func:`_compare_forces`, which warns.
        """
        contacts = self.contacts
        force = contacts.normal_force
        stiffness = contacts.normal_stiffness
        shear = contacts.shear_stiffness
        if force is not None:
            contacts.require_pushing(force, self.adhesive)
        self._require_springs(material, friction)
        if force is None or stiffness is None:
            assert material is not None
            coefficient = pairs.find_coefficient(material)
            find_force = partial(_force_of_overlap, coefficient, pairs.overlap)
            greatest_error, standard_error = self.balls.find_errors(pairs.i, pairs.j, pairs.normal)
            if force is None:
                contacts.refuse(
                    pairs.still,
                    "is with a body that does not move, and has no force",
                    mend="Give normal_force",
                )
                force = find_force()
                _judge_errors(contacts, self.balls, find_force, standard_error)
            elif stiffness is None:
                # the overlap with a body that does not move is not known
                comparable = np.where(pairs.still, np.nan, force)
                _compare_forces(contacts, comparable, find_force, greatest_error)
            if stiffness is None:
                unit = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
                stiffness = coefficient * unit.stiffness(unit.overlap(force / coefficient))
        if shear is None:
            ratio = 0.0
            if friction and material is not None:
                ratio = material.mindlin_ratio
            shear = stiffness * ratio
        return force, stiffness, shear

    def _require_springs(self, material: Material | None, friction: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the source lacks forces or
        stiffnesses, and there is no material from which they follow.
        """
        names = ["normal_force", "normal_stiffness"]
        if friction:
            names.append("shear_stiffness")
        lacking = [name for name in names if getattr(self.contacts, name) is None]
        if not lacking or material is not None:
            return
        mend = "Give the material of the balls, from which they follow, or the columns"
        if lacking == ["shear_stiffness"]:
            mend = "Give the column, the material of the balls, or friction=False"
        problem = f"{self.contacts.name} has no {', '.join(lacking)}, and no material is given"
        raise InputError(problem, mend=mend)

    def _is_level(self) -> bool:
        """Whether all balls are at one height z, and no contact leads up or down. A flat wall may
        have any place.
        """
        balls = self.balls
        is_ball = np.isfinite(balls.radii)  # a flat wall has none
        heights = balls.positions[is_ball, 2]
        if heights.size == 0 or np.ptp(heights) > _LEVEL * np.max(balls.radii[is_ball]):
            return False
        normal = self.contacts.normal
        return normal is None or bool(np.all(np.abs(normal[:, 2]) <= _LEVEL))

    def _judge_material(self, material: Material) -> None:
        """Warn of a density or a Young modulus that was probably given in another unit, where the
        network depends on that number.
        """
        for attribute, name, unit, limit, at_least in BALL_LIMITS.values():
            is_used = attribute != "material.density" or self.balls.masses is None
            if not attribute.startswith("material.") or not is_used:
                continue
            value = float(getattr(material, attribute.removeprefix("material.")))
            is_beyond = value < limit if at_least else value > limit
            if is_beyond:
                side = "below" if at_least else "above"
                fault = f"the {name} of the material is {value:g} {unit}, {side} {limit:g} {unit}"
                text = message(fault, WRONG_UNIT.capitalize())
                warnings.warn(text, InconsistencyWarning, stacklevel=4)

    def _compare_masses(self, material: Material) -> None:
        """Warn if the masses that are given differ from those of solid balls of the material, in
        the median by 5 % or more.
        """
        balls = self.balls
        assert balls.masses is not None
        is_moving = np.isfinite(balls.masses) & np.isfinite(balls.radii)
        if not np.any(is_moving):
            return
        solid_masses = material.density * (4.0 / 3.0 * math.pi) * balls.radii[is_moving] ** 3
        # sizes and masses that cannot be reckoned with are refused later
        with np.errstate(all="ignore"):
            ratio = float(np.median(balls.masses[is_moving] / solid_masses))
        if math.isfinite(ratio) and abs(ratio - 1.0) >= _LEAST_WARNED_RATIO:
            fault = (
                f"{balls.name}: the masses are {ratio:.4g} times those of solid balls of"
                f" {material.density:g} kg/m3"
            )
            why = "The masses count, and the density of the material does not"
            mend = (
                "Compare units and material. If balls are not solid, give the density of mass"
                " over volume"
            )
            warnings.warn(message(fault, why, mend), InconsistencyWarning, stacklevel=5)


def _warn_of_missing_forces(contacts: Contacts) -> None:
    """Warn that normal forces act without the tangential forces that belong to them."""
    fault = f"{contacts.name} has no tangential forces, and its normal ones act (prestress)"
    why = (
        "Contacts that resist slip bear both, of one order: without them a packing at"
        " rest may seem unstable"
    )
    mend = (
        "Give tx, ty, tz (p1, p2, p3 of compute pair/local) or tangential_x,"
        " tangential_y, tangential_z"
    )
    warnings.warn(message(fault, why, mend), InconsistencyWarning, stacklevel=4)


def _force_of_overlap(coefficient: Array, overlap: Array, error: Array | float = 0.0) -> Array:
    """Return the forces (n_c,), N, of Hertz's law at overlaps with an error, (n_c,), m."""
    return np.asarray(coefficient * HertzLaw(1.0).force(overlap + error))


def _judge_errors(
    contacts: Contacts, balls: Balls, find_force: Callable[..., Array], error: Array
) -> None:
    """Raise InputError if the forces that follow from overlaps have too large errors, or warn of
    such errors.

    ``error`` (n_c,) is the standard error of each overlap, m, and ``find_force`` returns the forces
    (n_c,), N, at overlaps with an error, m.
    """
    force_error = float(np.sum(find_force(error) - find_force(-error))) / 2.0
    total_force = float(np.sum(find_force()))
    error_share = force_error / total_force if force_error < total_force else 1.0
    if error_share <= _LEAST_WARNED_ERROR:
        return
    n_decimals = 0 if error_share > 0.1 else 1
    fault = (
        f"{contacts.name} has no forces, and those of the overlaps are off by"
        f" {error_share:.{n_decimals}%}, as"
        f" places of {balls.name} are rounded: {float(np.max(error)):.2g} m in an overlap"
    )
    mend = (
        "Write places with more digits (in LAMMPS: dump_modify 1 format float %.16g), or give the"
        " forces"
    )
    if error_share > _MOST_ERROR:
        raise InputError(fault, "An overlap is a small difference of places", mend)
    warnings.warn(message(fault, mend=mend), InconsistencyWarning, stacklevel=5)


def _compare_forces(
    contacts: Contacts, force: Array, find_force: Callable[..., Array], error: Array
) -> None:
    """Warn if forces (n_c,), N, are not those of Hertz's law at the overlaps: if one is more than
    ten times that force, or less than a tenth; or else if the forces of contacts with the mean
    force or more are all one multiple of it, by 5 % or more from one.

    ``error`` (n_c,) is the greatest error of each overlap, m, and ``find_force`` returns the forces
    (n_c,), N, at overlaps with an error, m: what such errors explain has no warning. Neither has a
    contact that bears, by both forces, less than a thousandth of the mean. A force of nan is not
    compared.
    """
    least = find_force(-error)
    expected = find_force(0.0)
    greatest = find_force(error)
    mean = np.nansum(force / force.size)
    is_odd = (force / _MOST_FACTOR > greatest) | (force < least / _MOST_FACTOR)
    is_odd &= np.maximum(force, least) > _LEAST_COMPARED * mean
    if np.any(is_odd):
        wrong = (
            f"has the force {_first(force, is_odd):.6g} N, and the overlap of its balls makes"
            f" {_first(expected, is_odd):.6g} N"
        )
        fault = contacts.describe(is_odd, wrong)
        mend = (
            "Compare units, material and columns. If the law is not Hertz's, give the stiffnesses"
        )
        warnings.warn(message(fault, mend=mend), InconsistencyWarning, stacklevel=5)
        return
    # of weak contacts the overlaps have large relative errors
    is_strong = (expected > 0.0) & (force >= mean)
    if not np.any(is_strong):
        return
    ratios = force[is_strong] / expected[is_strong]
    factor = float(np.median(ratios))
    scatter = float(np.median(np.abs(ratios / factor - 1.0)))
    spans = (greatest - least)[is_strong]
    rounding = float(np.median(spans / (2.0 * expected[is_strong])))
    is_one_factor = scatter <= _SAME + rounding
    if is_one_factor and abs(factor - 1.0) >= _LEAST_WARNED_RATIO + rounding:
        fault = (
            f"{contacts.name}: all forces are {factor:.4g} times those of Hertz's law at the"
            f" overlaps"
        )
        why = "The material or the law is another one"
        mend = "Compare units and Young's modulus. If the law is not Hertz's, give the stiffnesses"
        warnings.warn(message(fault, why, mend), InconsistencyWarning, stacklevel=5)


def read_whole_numbers(name: str, values: Any) -> Index:
    """Return ``values`` as an array of whole numbers; floats are taken if they are whole.

    Raises :class:`~granphon.base.errors.InputError` for other values, and for numbers too large to
    be an index.
    """
    if isinstance(values, np.ndarray) and values.dtype.kind == "i":
        return np.asarray(values, np.intp)
    numbers = real_array(name, values)
    if numbers.dtype.kind == "i":
        return np.asarray(numbers, np.intp)
    is_exact = np.isfinite(numbers) & (np.abs(numbers) < 2.0**53)  # floats beyond skip numbers
    is_whole = is_exact & (numbers == np.rint(numbers))
    if not np.all(is_whole):
        wrong = numbers[~is_whole].ravel()[0]
        raise InputError(
            f"{name} of the network has the number {wrong!s} where a whole number is needed"
        )
    return np.asarray(numbers, np.intp)


def find_rounding(values: Array) -> Array:
    """Return half a unit of the last digit of each of ``values``, of one source: their greatest
    errors, of the same shape.

    The number of digits that the source writes follows from all of its numbers. Where all are whole
    multiples of the last digit of the largest, the source writes as many decimals of each. Numbers
    that single precision holds have the digits of single precision. A few numbers of fewer digits
    than a program writes were chosen by hand, and have no error.
    """
    sizes = np.abs(values)
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    is_counted = (sizes < LARGEST) & (sizes > 1.0 / LARGEST)  # others are refused, or play no part
    least_digits, _most_digits = _DIGITS
    n_digits = _count_digits(sizes[is_counted])
    if n_digits < least_digits and np.unique(sizes[is_counted]).size < _CHOSEN:
        return np.zeros(values.shape)
    if n_digits >= least_digits and np.array_equal(single[is_counted], values[is_counted]):
        spacing = np.spacing(np.where(is_counted, np.abs(single), np.float32(1.0)))
        return np.where(is_counted, 0.5 * spacing, 0.0)
    # a unit of the last digit of each value
    exponents = np.floor(np.log10(np.where(is_counted, sizes, 1.0)))
    last_units = 10.0 ** (exponents - n_digits + 1.0)
    coarsest = float(np.max(last_units[is_counted]))
    steps = sizes[is_counted] / coarsest
    if np.allclose(steps, np.rint(steps), rtol=_EXACT, atol=0.0):
        last_units = np.full(values.shape, coarsest)
    return np.where(is_counted, 0.5 * last_units, 0.0)


def _count_digits(sizes: Array) -> int:
    """Return the least number of significant digits that represent all of ``sizes`` (n,), which are
    above zero; at most that of floats.
    """
    _least_digits, most_digits = _DIGITS
    mantissas = sizes / 10.0 ** np.floor(np.log10(sizes))  # from 1 to 10
    for n_digits in range(1, most_digits):
        power = 10.0 ** (n_digits - 1)
        rounded = np.rint(mantissas * power) / power
        if np.allclose(rounded, mantissas, rtol=_EXACT, atol=0.0):
            return n_digits
    return most_digits


def _first(values: Array, bad: Flags) -> float:
    """Return the one of ``values`` (n_c,) that belongs to the first contact that is ``bad`` (n_c,);
    nan if none is.
    """
    return float(values[np.argmax(bad)]) if np.any(bad) else math.nan


def _leave_out(fields: Mapping[str, Any], is_open: Flags) -> dict[str, Any]:
    """Return the fields of the contacts but those that are open, (n_c,)."""
    return {name: values[~is_open] for name, values in fields.items()}


def _round_steps(steps: Array) -> Index:
    """Return the nearest whole numbers of cells; :class:`InputError` if balls are too many cells
    from each other.
    """
    is_near = np.abs(steps) <= MOST_STEPS  # False for nan
    if not np.all(is_near):
        problem = f"balls that touch are more than {MOST_STEPS} cells apart"
        raise InputError(problem, mend="Compare cell and places")
    return np.asarray(np.rint(steps), np.intp)
