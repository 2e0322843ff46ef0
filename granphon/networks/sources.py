"""Balls and contacts as a program of discrete elements has left them, in SI units, with their
faults, and with the errors that rounding in the files leaves; and the tangential laws of such
programs.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, NamedTuple, Self, TypedDict

import numpy as np

from granphon.balls.material import Material
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, brief
from granphon.base.validation import choice, real_array, require, truth, whole_number
from granphon.networks.faults import FAULT_ACTIONS, Faults

#: greatest number in SI, and the inverse of the least one: products of a few of them stay within
#: the range of floats
LARGEST_NUMBER = 1e60
#: least volume, or area, that periods span, over the product of their lengths
_LEAST_VOLUME = 1e-9
#: greatest number of cells between two balls
MOST_STEPS = 1_000_000_000
#: the largest file of balls or contacts that is read, bytes: that of some millions of contacts
MOST_BYTES = 4_000_000_000
#: deviation of the length of a normal from one, or of a normal from the plane, that is put down to
#: rounding in a file
UNIT_TOLERANCE = 1e-6
#: greatest part of a tangential force along the normal: the rounding in a file
_ALONG_TOLERANCE = 1e-2
#: part of a tangential force along the normal, over the normal force, that is rounding
_LEAST_ALONG = 1e-12
#: least and greatest number of significant digits with which a program writes numbers
_DIGITS = (6, 15)
#: number of different values of fewer digits from which on the values are rounded, not chosen by
#: hand
_LEAST_VALUES = 100
#: moment of inertia of a solid sphere over m r^2
SOLID_INERTIA = 0.4
#: least whole number that is not told from the next one as a float
_FIRST_INEXACT = 2**53
#: greatest relative error of a number that is read from a text and converted into SI
_DIGIT_TOLERANCE = 1e-14
#: the unit of each field of contacts that holds numbers with one
_UNITS = {
    "vector": "m",
    "normal": "",
    "force": "N",
    "tangential_force": "N",
    "contact_torque": "N m",
    "rolling_force": "N",
    "twisting_torque": "N m",
    "normal_force": "N",
    "overlap": "m",
    "normal_stiffness": "N/m",
    "shear_stiffness": "N/m",
    "torsion_stiffness": "N m",
    "bending_stiffness": "N m",
    "arm_i": "m",
    "arm_j": "m",
}


class TangentialLaw(NamedTuple):
    """How a static tangential force changes while the slip stays.

    Attributes
    ----------
    power : the power p of the overlap to which the force is proportional.
    turns : whether the force turns about the normal with the balls, by the mean of their rotations.
    levers : one of :data:`SLIP_LEVERS`, the levers of slip in the program.
    """

    power: float
    turns: bool = False
    levers: str = "arms"


#: the tangential laws, by their names in other programs
TANGENTIAL_LAWS = {
    "mindlin/force": TangentialLaw(0.0),
    "mindlin": TangentialLaw(0.5),
    "mindlin_rescale/force": TangentialLaw(0.25),
    "mindlin_rescale": TangentialLaw(0.75),
    "yade": TangentialLaw(0.0, turns=True, levers="yade"),
    "liggghts": TangentialLaw(0.5),
}
#: greatest difference, over the sum of the two arms, between these and the distance of the centres
_ARM_TOLERANCE = 0.25
#: how rotations and displacements make slip, see the field ``slip_levers`` of
#: :class:`~granphon.networks.network.ContactNetwork`
SLIP_LEVERS = ("arms", "radii", "yade")


@dataclass(frozen=True)
class Balls:
    """The balls of a source, in SI; None for fields that the source does not have.

    ``name`` is the name of the source in messages. Positions are (n, 1), (n, 2) or (n, 3); the
    other fields are (n,). ``labels`` are whole numbers that name the balls. ``still`` are bodies
    that do not move, whatever their masses. ``rounding``, of the shape of the positions, and
    ``radius_rounding`` (n,) are the greatest errors that the digits of the source leave in
    positions and radii, m. ``lines`` are the lines of the balls in a file. ``on_site`` are
    stiffnesses (n,) of springs to the ground by their names, N/m and N m.
    """

    name: str
    positions: Array
    radii: Array
    rounding: Array
    radius_rounding: Array
    masses: Array | None = None
    inertias: Array | None = None
    labels: Index | None = None
    kinds: tuple[str, ...] | None = None
    still: Flags | None = None
    lines: Index | None = None
    on_site: Mapping[str, Array] = field(default_factory=dict)

    @property
    def fixed(self) -> Flags:
        """(n,) whether each body does not move: as the source says, or by an infinite mass."""
        is_fixed = np.zeros(len(self.radii), bool) if self.still is None else self.still
        return is_fixed if self.masses is None else is_fixed | np.isinf(self.masses)

    def describe(self, row: int) -> str:
        """Return the words that name a ball, by its index."""
        line = "" if self.lines is None else f" in line {self.lines[row]}"
        return f"ball {row if self.labels is None else self.labels[row]}{line}"

    def find_faults(self) -> Faults:
        """Return the balls that cannot be used: with a place or radius out of range, with a mass or
        moment of inertia that is not above zero, or with a label that another ball has, too.
        """
        faults = Faults(self.name, "balls", len(self.radii), self.describe)
        is_placed = np.all(np.abs(self.positions) < LARGEST_NUMBER, axis=1)
        words = "a place that is not finite, or too large"
        faults.note(~is_placed, words, values=self.positions, unit="m")
        is_flat_wall = self.fixed & np.isinf(self.radii)
        is_sized = (self.radii > 0.0) & ((self.radii < LARGEST_NUMBER) | is_flat_wall)
        why = ""
        if np.any(np.isinf(self.radii) & ~is_sized):
            why = "Only a body that does not move may have a radius of inf"
        words = "a radius that is not above zero, not finite, or too large"
        faults.note(~is_sized, words, values=self.radii, unit="m", why=why)
        for name, values, unit in (
            ("mass", self.masses, "kg"),
            ("moment of inertia", self.inertias, "kg m^2"),
        ):
            if values is not None:
                words = f"a {name} that is not above zero"
                faults.note(~(values > 0.0), words, values=values, unit=unit)
        if self.labels is not None:
            _labels, index, counts = np.unique(self.labels, return_inverse=True, return_counts=True)
            words = "an id that another ball has too"
            faults.note(counts[index] > 1, words, mend="Give each an id of its own")
        return faults


@dataclass(frozen=True)
class Reading:
    """What is known of a network that was read, beside its numbers.

    ``balls`` and ``contacts`` are the names of its sources in messages; ``notes`` say what has been
    passed over, and why. ``rounding`` (n, 3) and ``radius_rounding`` (n,) are the greatest errors
    that the digits of the source leave in positions and radii, m.
    """

    balls: str
    contacts: str
    notes: tuple[str, ...]
    rounding: Array
    radius_rounding: Array


class CompletionOptions(TypedDict, total=False):
    """The types of the fields of a :class:`Completion` but the material."""

    friction: bool
    dimension: int | None
    motions: str | None
    prestress: bool | None
    tangential_law: str | None
    slip_levers: str | None
    keep_rattlers: bool
    held_by: int | None
    bad: str


@dataclass(frozen=True)
class Completion:
    """The arguments that all readers have in common, which say how the fields of a network follow
    from what a source has.

    They are described at :meth:`granphon.networks.network.ContactNetwork.from_table`. InputError
    for values of another kind.
    """

    material: Material | None = None
    friction: bool = True
    dimension: int | None = None
    motions: str | None = None
    prestress: bool | None = None
    tangential_law: str | None = None
    slip_levers: str | None = None
    keep_rattlers: bool = False
    held_by: int | None = None
    bad: str = "refuse"

    def __post_init__(self) -> None:
        """Check the material, ``bad``, ``held_by`` and the truth values; the other arguments are
        checked with the fields of the network.
        """
        material: Any = self.material
        if not isinstance(material, Material | None):
            raise InputError(f"the material is {brief(material)}", mend="Give a gp.Material")
        require("bad", partial(choice, options=FAULT_ACTIONS), self.bad)
        if self.held_by is not None:
            whole_number("held_by", self.held_by, 0)
        for name in ("friction", "prestress", "keep_rattlers"):
            value = getattr(self, name)
            if name != "prestress" or value is not None:
                require(name, truth, value)

    @property
    def of_network(self) -> dict[str, Any]:
        """The given arguments that are fields of the network, by name; None is not given."""
        names = ("dimension", "motions", "prestress", "tangential_law", "slip_levers")
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class Contacts:
    """The contacts of a source, in SI; None for fields that the source does not have.

    ``i`` and ``j`` are labels of balls, or their indices where balls have no labels. ``normal``,
    ``vector`` from the centre of ball i to that of ball j, ``force`` and ``tangential_force``, with
    which ball i acts on ball j, and ``shift``, whole cells by which ball j is displaced, are
    (n_c, 3); the other arrays are (n_c,). Forces that press are positive. ``lines`` are the lines
    of the contacts in a file.

    ``contact_torque`` (n_c, 3) is the static torque of rolling and twist with which ball i acts on
    ball j. Sources of LAMMPS have two parts of it: ``rolling_force`` f (n_c, 3) on ball j, whose
    torque is -R n x f with the reduced radius R, and ``twisting_torque`` (n_c,), along n.

    ``rolling`` is the coefficient k of LAMMPS' rolling law, N/m: the bending stiffness is k R^2,
    where R is the reduced radius; or "epsd2" for that law of LIGGGHTS, in which k is the shear
    stiffness. ``twisting`` is the torsion stiffness, N m; or "marshall" for Marshall's law, by
    which the torsion stiffness is half of the shear coefficient times the square of the radius of
    the contact spot.
    """

    name: str
    i: Index
    j: Index
    shift: Index | None = None
    vector: Array | None = None
    normal: Array | None = None
    force: Array | None = None
    tangential_force: Array | None = None
    contact_torque: Array | None = None
    rolling_force: Array | None = None
    twisting_torque: Array | None = None
    normal_force: Array | None = None
    overlap: Array | None = None
    normal_stiffness: Array | None = None
    shear_stiffness: Array | None = None
    torsion_stiffness: Array | None = None
    bending_stiffness: Array | None = None
    arm_i: Array | None = None
    arm_j: Array | None = None
    lines: Index | None = None
    rolling: float | str | None = None
    twisting: float | str | None = None

    def __len__(self) -> int:
        """Return the number of contacts."""
        return len(self.i)

    def select(self, rows: Any) -> Self:
        """Return some of the contacts, given by their indices or by truth values (n_c,)."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        return replace(self, **{name: array[rows] for name, array in arrays.items()})

    def describe(self, row: int) -> str:
        """Return the words that name a contact, by its index."""
        line = "" if self.lines is None else f" in line {self.lines[row]}"
        return f"balls {self.i[row]} and {self.j[row]}{line}"

    def start_faults(self) -> Faults:
        """Return an empty list of the faults of these contacts."""
        return Faults(self.name, "contacts", len(self), self.describe)

    def note_numbers(self, faults: Faults, *, adhesive: bool) -> None:
        """Note, in ``faults``, the contacts with numbers that are not finite or out of range, with
        a normal force that pulls unless contacts are ``adhesive``, with a shift of too many cells,
        and with a normal whose length is not one.
        """
        for name, unit in _UNITS.items():
            values = getattr(self, name)
            if values is None:
                continue
            article = "an" if name.startswith(("a", "o")) else "a"
            words = f"{article} {name} that is not finite, or too large"
            is_in_range = np.abs(values) < LARGEST_NUMBER  # False for nan
            if values.ndim > 1:
                is_in_range = is_in_range.all(axis=1)
            faults.note(~is_in_range, words, values=values, unit=unit)
            if name.endswith("stiffness"):
                must_be_above = name == "normal_stiffness"
                is_low = values <= 0.0 if must_be_above else values < 0.0
                words = f"a {name} that is {'not above' if must_be_above else 'below'} zero"
                faults.note(is_low, words, values=values, unit=unit)
        if self.normal_force is not None:
            note_pulling(faults, self.normal_force, adhesive)
        if self.shift is not None:
            is_far = ~np.all(np.abs(self.shift) <= MOST_STEPS, axis=1)
            faults.note(is_far, f"a shift of more than {MOST_STEPS} cells")
        if self.normal is not None:
            # squares of larger numbers might overflow
            length = np.linalg.norm(np.clip(self.normal, -2.0, 2.0), axis=1)
            words = "a normal whose length is not one"
            faults.note(np.abs(length - 1.0) > UNIT_TOLERANCE, words, values=self.normal)


def span_distance(arms: Array, vector: Array) -> Flags:
    """Return (n_c,) whether the sum of the two arms of each contact, ``arms`` (n_c,), m, is the
    length of the ``vector`` (n_c, 3), m, from centre to centre, to a quarter of the sum.
    """
    return np.asarray(
        np.abs(np.linalg.norm(vector, axis=1) - arms) <= _ARM_TOLERANCE * np.abs(arms)
    )


def are_across(tangential: Array, normal: Array, normal_force: Array | float) -> Flags:
    """Return (n_c,) whether each of the ``tangential`` forces (n_c, 3), N, is across the ``normal``
    (n_c, 3) of its contact, but for rounding; ``normal_force`` is (n_c,), N, or the number zero if
    it is not known.

    Rounding is a part along the normal up to the sum of :data:`_ALONG_TOLERANCE` times the
    tangential force, :data:`_LEAST_ALONG` times the normal force, and the least float of full
    precision.
    """
    along = np.abs(np.einsum("ca,ca->c", tangential, normal))
    rounding = _LEAST_ALONG * np.abs(normal_force) + np.finfo(float).tiny
    return np.asarray(along <= _ALONG_TOLERANCE * np.linalg.norm(tangential, axis=1) + rounding)


def are_independent(periods: Array) -> bool:
    """Whether the ``periods`` (p, 3), m, each longer than zero, are independent, and not nearly
    dependent: the volume or area that unit vectors along them span is :data:`_LEAST_VOLUME` or
    more. A single period, or none, is independent.
    """
    directions = periods / np.linalg.norm(periods, axis=1, keepdims=True)
    return bool(np.prod(np.linalg.svd(directions, compute_uv=False)) >= _LEAST_VOLUME)


def note_pulling(faults: Faults, force: Array, adhesive: bool, mend: str = "") -> None:
    """Note, in ``faults``, the contacts whose normal ``force`` (n_c,), N, pulls, unless contacts
    are ``adhesive``; ``mend`` is the advice of the message, "" for the usual one.
    """
    if not adhesive:
        faults.note(
            force < 0.0,
            "a force that pulls",
            values=force,
            unit="N",
            why="Forces that pull are not of elastic balls",
            mend=mend or "Forces that press count as positive",
        )


def read_whole_numbers(name: str, values: Any) -> Index:
    """Return ``values``, a number or an array, as an array of whole numbers, of the same shape;
    floats are accepted if they are whole.

    Raises :class:`~granphon.base.errors.InputError`, which names the field ``name``, for other
    values, and for floats whose size is 2^53 or more, which are not exact.
    """
    if type(values) is np.ndarray and values.dtype.kind == "i":  # not a masked array, for instance
        return np.asarray(values, np.intp)
    numbers = real_array(name, values)
    if numbers.dtype.kind == "i":
        return np.asarray(numbers, np.intp)
    is_exact = np.isfinite(numbers) & (np.abs(numbers) < _FIRST_INEXACT)
    is_whole = is_exact & (numbers == np.rint(numbers))
    if not np.all(is_whole):
        wrong = numbers[~is_whole].ravel()[0]
        limit = "" if np.abs(wrong) < _FIRST_INEXACT else " below 2^53"
        raise InputError(
            f"{name} of the network has the number {wrong!s} where a whole number{limit} is needed"
        )
    return np.asarray(numbers, np.intp)


def require_readable_labels(labels: Index) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for ``labels`` (n,) of balls that could not
    be read again from a file: whole numbers are read as floats (:func:`read_whole_numbers`), which
    are not exact from the size 2^53 on.
    """
    # not by np.abs, which overflows for the least whole number of 64 bits
    is_inexact = (labels >= _FIRST_INEXACT) | (labels <= -_FIRST_INEXACT)
    if np.any(is_inexact):
        fault = f"a ball of the network has the label {labels[is_inexact][0]}"
        why = "Labels of the size 2^53 or more could not be read again from a file"
        mend = "Give labels nearer to zero: dataclasses.replace(network, labels=...)"
        raise InputError(fault, why, mend)


def require_balls(name: str, headings: Collection[str], known: Collection[str]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the table ``name`` of these ``headings``
    holds contacts, where the columns ``known`` are those of balls.
    """
    names_ends = {"i", "j"} <= set(headings)
    if names_ends and "i" not in known and not {"radius", "diameter"} & set(headings):
        fault = f"{name}: these are contacts, where balls are needed"
        raise InputError(fault, mend="Give the table of balls first, and then that of contacts")


def find_rounding(values: Array) -> Array:
    """Return the greatest rounding errors of ``values``, an array of any shape that one source has
    written: half a unit of the last digit of each, in an array of the same shape.

    How many digits the source writes is found from all values together, in three cases:

    - A few different values with fewer digits than a program writes were chosen by hand: their
      error is zero.
    - Values of six digits or more that single precision holds exactly were numbers of single
      precision: their error is half of the distance to the next such number.
    - Otherwise each value has the number of significant digits that represents all values; or, if
      all are whole multiples of the last digit of the largest, the same number of decimals.

    The error of a value that is zero or out of range is zero, as it plays no part or is refused.
    """
    sizes = np.abs(values)
    with np.errstate(over="ignore"):
        single_precision = values.astype(np.float32)
    is_counted = (sizes < LARGEST_NUMBER) & (sizes > 1.0 / LARGEST_NUMBER)
    least_digits, _most_digits = _DIGITS
    n_digits = _count_digits(sizes[is_counted])
    if n_digits < least_digits and np.unique(sizes[is_counted]).size < _LEAST_VALUES:
        return np.zeros(values.shape)
    if n_digits >= least_digits and np.array_equal(
        single_precision[is_counted], values[is_counted]
    ):
        spacing = np.spacing(np.where(is_counted, np.abs(single_precision), np.float32(1.0)))
        spacing = spacing.astype(float)
        return np.where(is_counted, 0.5 * spacing, 0.0)
    # a unit of the last digit of each value
    exponents = np.floor(np.log10(np.where(is_counted, sizes, 1.0)))
    last_units = 10.0 ** (exponents - n_digits + 1.0)
    coarsest = float(np.max(last_units[is_counted]))
    steps = sizes[is_counted] / coarsest
    if np.allclose(steps, np.rint(steps), rtol=_DIGIT_TOLERANCE, atol=0.0):
        last_units = np.full(values.shape, coarsest)
    return np.where(is_counted, 0.5 * last_units, 0.0)


def find_errors_of_overlaps(
    rounding: Array, radius_rounding: Array, i: Index, j: Index, normal: Array
) -> tuple[Array, Array]:
    """Return the greatest and the standard errors, each (n_c,), m, that rounding leaves in the
    overlaps of balls i and j.

    ``rounding`` (n, d) and ``radius_rounding`` (n,) are the greatest errors of positions and radii,
    m; ``normal`` is (n_c, 3).
    """
    weights = np.abs(normal[:, : rounding.shape[1]])  # of the error along each axis
    greatest_errors = np.einsum("ca,ca->c", weights, rounding[i] + rounding[j])
    greatest_errors = greatest_errors + radius_rounding[i] + radius_rounding[j]
    squares = np.einsum("ca,ca->c", weights**2, rounding[i] ** 2 + rounding[j] ** 2)
    squares = squares + radius_rounding[i] ** 2 + radius_rounding[j] ** 2
    # each rounding error is uniformly distributed up to the greatest one: its variance is a third
    # of the square of the greatest
    return greatest_errors, np.sqrt(squares / 3.0)


def _count_digits(sizes: Array) -> int:
    """Return the least number of significant digits that represents all of ``sizes`` (n,), which
    are above zero; 15 at most, the number of digits that every float keeps.
    """
    _least_digits, most_digits = _DIGITS
    mantissas = sizes / 10.0 ** np.floor(np.log10(sizes))  # from 1 to 10
    for n_digits in range(1, most_digits):
        power = 10.0 ** (n_digits - 1)
        rounded = np.rint(mantissas * power) / power
        if np.allclose(rounded, mantissas, rtol=_DIGIT_TOLERANCE, atol=0.0):
            return n_digits
    return most_digits


def find_repeated(
    i: Index, j: Index, shift: Index, normal: Array, both_move: Flags
) -> tuple[Index, Index]:
    """Return the indices (m,) of contacts that are listed twice, and the indices (m,) of their
    repetitions, which may be listed from the same end or from the other one.

    ``i`` and ``j`` (n_c,), ``shift`` and ``normal`` (n_c, 3) are those of the contacts.
    ``both_move`` (n_c,) says whether both balls of a contact move: a wall may touch a ball at
    several places, so that two contacts with a wall are the same only if their normals are.
    """
    # Each contact is compared as seen from the ball with the lower index. A contact of a ball with
    # its own image has no such ball: it is seen from the end from which it leaves the cell upwards,
    # along the first axis along which it leaves the cell at all.
    first_axis = np.argmax(shift != 0, axis=1)[:, None]
    first_shift = np.take_along_axis(shift, first_axis, axis=1)[:, 0]
    is_from_higher = (i > j) | ((i == j) & (first_shift < 0))
    # (n_c,) a number of the pair of balls, and (n_c, 3) the cells from its lower to its higher ball
    n_balls = int(max(np.max(i, initial=0), np.max(j, initial=0))) + 1
    pair = np.where(is_from_higher, j, i) * n_balls + np.where(is_from_higher, i, j)
    step = np.where(is_from_higher[:, None], -shift, shift)
    seen_normal = np.where(is_from_higher[:, None], -normal, normal)
    # normals play no part between balls that move; contacts with a wall that have the same normal
    # must follow each other
    key_normal = np.where(both_move[:, None], 0.0, seen_normal)
    contacts, twins = _find_twins(pair, step, key_normal)
    deviation = np.abs(key_normal[contacts] - key_normal[twins])
    is_repeated = ~np.any(deviation > UNIT_TOLERANCE, axis=1)
    return contacts[is_repeated], twins[is_repeated]


def _find_twins(pair: Index, step: Index, normal: Array) -> tuple[Index, Index]:
    """Return the indices (m,) of contacts, and the indices (m,) of their twins, later contacts with
    the same ``pair`` and ``step``. Of three such contacts the second is the twin of the first, and
    the third that of the second, in ascending order of the ``normal``, or as they are listed where
    normals are equal.

    ``pair`` (n_c,) is a number of the two balls of a contact, ``step`` (n_c, 3) the cells between
    them, and ``normal`` (n_c, 3) a vector.
    """
    by_pair = np.argsort(pair, kind="stable")
    is_as_previous = np.diff(pair[by_pair], prepend=-1) == 0
    is_as_following = np.append(is_as_previous[1:], False)
    # Only contacts whose pair has several contacts are sorted by their steps, too. There are few of
    # them, as balls rarely touch through more than one image.
    contacts = by_pair[is_as_previous | is_as_following]
    keys = (*normal[contacts].T, *step[contacts].T, pair[contacts])  # the last key counts first
    contacts = contacts[np.lexsort(keys)]
    has_same_pair = np.diff(pair[contacts]) == 0
    has_same_step = ~np.any(np.diff(step[contacts], axis=0), axis=1)
    is_twin = has_same_pair & has_same_step
    first_contacts = contacts[:-1][is_twin]
    next_contacts = contacts[1:][is_twin]
    return np.minimum(first_contacts, next_contacts), np.maximum(first_contacts, next_contacts)
