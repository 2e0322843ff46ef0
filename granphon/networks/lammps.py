"""Networks from dumps of LAMMPS, and networks written as such dumps.

A network is in two dumps of the same time step: one of atoms and one of pairs that touch. Contacts
with walls are in columns of the dump of atoms.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granphon.balls.hertz import HertzLaw, overlap_from
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import (
    InconsistencyWarning,
    InputError,
    brief,
    message,
    warn_caller,
)
from granphon.base.scales import Units
from granphon.base.staging import write_texts
from granphon.base.text import join_numbers, list_names, require_path
from granphon.base.validation import choice, not_negative, positive, require, texts, whole_number
from granphon.networks.building import Source
from granphon.networks.dumps import OWN_MARK, Dump, Frame
from granphon.networks.sources import (
    SOLID_INERTIA,
    Balls,
    Contacts,
    find_rounding,
    require_readable_labels,
)

#: length (m), mass (kg) and force (N) that are one in LAMMPS' styles of units
_STYLES = {
    "si": (1.0, 1.0, 1.0), "cgs": (1e-2, 1e-3, 1e-5), "micro": (1e-6, 1e-15, 1e-9),
    "nano": (1e-9, 1e-21, 1e-12),
}  # fmt: skip
#: advice for the style "lj", whose units are those of the user's choice
_ADVICE_ON_SCALES = "Give the scales, units=gp.Units(length, stiffness, mass), in SI"
#: greatest difference of two boxes that are one, over the longest component of their vectors: the
#: dumps may be written with few digits
_BOX_TOLERANCE = 1e-5
#: the last time step that LAMMPS counts
_LAST_STEP = 2**63 - 1
#: names of the vectors of pairs, each with its components
_VECTORS = {
    "vector": ("dx", "dy", "dz"),
    "tangential_force": ("tx", "ty", "tz"),
    "force": ("fx", "fy", "fz"),
    "rolling_force": ("rx", "ry", "rz"),
}
#: columns of pairs that are read
COLUMNS_OF_PAIRS = ("i", "j", "force", "delta", *_VECTORS["vector"], *_VECTORS["tangential_force"],
            *_VECTORS["force"], *_VECTORS["rolling_force"], "twist")  # fmt: skip
#: columns of atoms that have no note if they are not read: another column counts in their place
_COLUMNS_OF_ATOMS = ("id", "type", "element", "radius", "diameter", "mass")
#: ends of the names of columns of places: "s" of fractions of the box, "u" of places that are not
#: wrapped back into the box
_PLACE_SUFFIXES = ("", "u", "s", "su")
#: advice for a dump without the columns of atoms or of pairs that are needed
_ADVICE_ON_ATOMS = "Write it with: dump 1 all custom 1000 atoms.dump id x y z radius mass"
_ADVICE_ON_PAIRS = (
    "Name them in LAMMPS, dump_modify 2 colname 1 i colname 2 j, or here: columns=['i', 'j',"
    " 'force', ...]"
)
#: the columns of a fix wall/gran with the keyword contacts: of a force, of a place on the wall
_WALL_FORCE = (2, 3, 4)
_WALL_PLACE = (5, 6, 7)
#: what dumps of granphon's own say after their units: fields of the network, the names of its walls
#: (with commas), and where forces of walls act
_FIELDS_OF_NETWORK = ("tangential_law", "slip_levers")
_PRESTRESS = "prestress"
_WALLS = "walls"
_WALL_ARMS = "wall_arms"
#: the word for forces of walls that act amid the overlap; they act at the radius otherwise
_AMID_OVERLAP = "middle"
#: greatest relative difference of stiffnesses that are of one material, and of moments of inertia
#: that are those of solid balls: files round numbers
_SPRING_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Scales:
    """The length, m, the mass, kg, and the force, N, that are one in the files."""

    length: float
    mass: float
    force: float

    @classmethod
    def find(cls, units: str | Units | None, frames: Sequence[Frame]) -> Scales:
        """Return the scales of the ``units``, a style by its name or the scales of the style "lj"
        as :class:`~granphon.base.scales.Units`; for None those of the style that the ``frames``
        name, or of SI if they name none.

        InputError for an unknown style, for the style "lj" by its name, for frames of different
        styles, for a style other than that of the frames, and without ``units`` for frames of a
        style whose units in SI are not known.
        """
        # frames that name no style have that of the others
        frames_with_units = [frame for frame in frames if frame.units]
        styles_of_files = {frame.units for frame in frames_with_units}
        if len(styles_of_files) > 1:
            listed = ", and ".join(
                f"{frame.name} is in units {frame.units}" for frame in frames_with_units
            )
            raise InputError(listed, mend="Write both with the same units")
        style_of_files = next(iter(styles_of_files), "")
        fault = ""
        mend = "Leave units out"
        if style_of_files:
            first_frame = frames_with_units[0]
            fault = f"{first_frame.name} says that its units are {brief(style_of_files, 40)}"
            # without a scale in SI for the style of the files, leaving units out would not help
            if style_of_files == "lj":
                mend = _ADVICE_ON_SCALES
            elif style_of_files not in _STYLES:
                mend = f"Write it in {', '.join(_STYLES)}"
        if isinstance(units, Units):
            style = "lj"
            scales = (units.length, units.mass, units.force)
        elif units is None:
            style = style_of_files or "si"
            if style not in _STYLES:
                raise InputError(fault, "Their lengths and masses in SI are not known", mend)
            scales = _STYLES[style]
        elif units == "lj":
            raise InputError(
                "the units 'lj' are given without their scales", mend=_ADVICE_ON_SCALES
            )
        else:
            style = require("units", lambda value: choice(value, [*_STYLES]), units)
            scales = _STYLES[style]
        if style_of_files not in ("", style):
            argument = "a gp.Units, for units lj," if style == "lj" else f"units={style!r}"
            raise InputError(f"{fault}, and {argument} is given", mend=mend)
        return cls(*scales)


@dataclass(frozen=True)
class Springs:
    """Stiffnesses that all contacts of the files have in common; None where the user gives none.

    ``normal`` and ``shear`` are in N/m; without them stiffnesses follow from the material.
    ``rolling`` is the coefficient k of LAMMPS' rolling law, N/m, or "epsd2", a law of LIGGGHTS;
    ``twisting`` is that of LAMMPS' twisting law, N m, or "marshall"; without them contacts roll and
    twist freely. InputError for a number out of range, and for another word.
    """

    normal: float | None = None
    shear: float | None = None
    rolling: float | str | None = None
    twisting: float | str | None = None

    def __post_init__(self) -> None:
        """Check the stiffnesses that are given; the names in messages are those of the reader."""
        if self.normal is not None:
            positive("normal_stiffness", self.normal, "N/m")
        if self.shear is not None:
            not_negative("shear_stiffness", self.shear, "N/m")
        if isinstance(self.rolling, str):
            require("rolling_stiffness", lambda word: choice(word, ["epsd2"]), self.rolling)
        elif self.rolling is not None:
            not_negative("rolling_stiffness", self.rolling, "N/m")
        if isinstance(self.twisting, str):
            require("twisting_stiffness", lambda word: choice(word, ["marshall"]), self.twisting)
        elif self.twisting is not None:
            not_negative("twisting_stiffness", self.twisting, "N*m")

    def of(self, count: int) -> dict[str, Any]:
        """Return, by name, the fields of :class:`~granphon.networks.sources.Contacts` that give
        these stiffnesses to ``count`` contacts: normal and shear stiffnesses as arrays (count,),
        left out where none is given, and ``rolling`` and ``twisting`` as they are.
        """
        fields: dict[str, Any] = {"rolling": self.rolling, "twisting": self.twisting}
        for name, number in (("normal_stiffness", self.normal), ("shear_stiffness", self.shear)):
            if number is not None:
                fields[name] = np.full(count, float(number))
        return fields


def read_dumps(
    dump: Any,
    pairs: Any,
    *,
    units: str | Units | None,
    columns: Sequence[str] | None,
    step: int | None,
    springs: Springs,
    walls: str | Sequence[str],
    frozen: Mapping[str, Any] | None,
) -> Source:
    """Return the balls and contacts of two dumps of one time step and one box, in SI units; see
    ``ContactNetwork.from_lammps`` for the arguments and errors.

    ``slip_levers`` of the source are "radii", by which LAMMPS computes slip. Where dumps of
    granphon's own say their levers, their law of tangential forces or ``prestress``, the source has
    these, and the walls that they name are read unless ``walls`` names others.
    """
    atoms, contact_frame = find_frames(dump, pairs, step)
    scales = Scales.find(units, [atoms, contact_frame])
    if springs.rolling is not None:  # "epsd2" is a law of LIGGGHTS alone
        not_negative("rolling_stiffness", springs.rolling, "N/m")
    if columns is not None:
        contact_frame = replace(contact_frame, names=read_names(columns, contact_frame))
    options = atoms.options
    names_of_walls = _read_walls(walls) or _list_own_walls(atoms)
    contacts = read_contacts(contact_frame, scales, springs)
    balls = read_balls(atoms, scales, frozen)
    lists = [contacts]
    for number, wall in enumerate(names_of_walls, 1):
        label = -number
        lists.append(_read_wall(atoms, balls, wall, label, scales, springs))
        balls = add_wall(balls, label, wall)
    notes = note_pairs(contact_frame, springs)
    notes += note_atoms(atoms, names_of_walls, frozen)
    own_fields: dict[str, Any] = {
        name: options[name] for name in _FIELDS_OF_NETWORK if name in options
    }
    if _PRESTRESS in options:
        own_fields[_PRESTRESS] = options[_PRESTRESS] == str(True)
    source = make_source(atoms, scales, balls, lists, notes)
    return replace(source, **{"slip_levers": "radii"} | own_fields)


def make_source(
    atoms: Frame, scales: Scales, balls: Balls, lists: Sequence[Contacts], notes: Sequence[str]
) -> Source:
    """Return the source of ``balls`` and ``lists`` of contacts, both in SI, in the box of a frame
    of ``atoms``, with those of the ``notes`` that are not empty.
    """
    return Source(
        balls,
        tuple(lists),
        scales.length * atoms.cell,
        np.asarray(atoms.pbc, bool),
        notes=tuple(note for note in notes if note),
    )


def find_frames(dump: Any, pairs: Any, step: int | None) -> tuple[Frame, Frame]:
    """Return the frames of atoms and of pairs at one time ``step``, or for None the last frame of
    each file. InputError unless both frames are of one step and one box, and as
    :meth:`~granphon.networks.dumps.Dump.find`.

    ``dump`` and ``pairs`` are paths, or files that are open
    (:class:`~granphon.networks.dumps.Dump`).
    """
    step = None if step is None else whole_number("step", step, 0, _LAST_STEP)
    atoms = Dump.open(dump, "atoms").find(step)
    contact_frame = Dump.open(pairs, "entries").find(step)
    if atoms.step != contact_frame.step:
        fault = (
            f"{atoms.name} ends at the time step {atoms.step}, and {contact_frame.name} at"
            f" {contact_frame.step}"
        )
        why = "Balls and contacts must be of one step"
        raise InputError(fault, why, "Give the step that both have")
    deviations = np.abs(atoms.cell - contact_frame.cell)
    has_same_cell = np.all(deviations <= _BOX_TOLERANCE * np.max(np.abs(atoms.cell)))
    if not has_same_cell or np.any(atoms.pbc != contact_frame.pbc):
        fault = f"{atoms.name} and {contact_frame.name} have different boxes"
        raise InputError(fault, mend="Are they of one simulation?")
    return atoms, contact_frame


# -- pairs -----------------------------------------------------------------------------------------


def read_contacts(pairs: Frame, scales: Scales, springs: Springs) -> Contacts:
    """Return the contacts of a dump of pairs, in SI units; InputError without ids, and for ids that
    are no whole numbers.

    Static torques of rolling and twist are read only where the ``springs`` have a law of these
    (:func:`list_lawless`).
    """
    require_columns(pairs, ("i", "j"), _ADVICE_ON_PAIRS)
    lawless = list_lawless(pairs, springs)
    names_read = [name for name in COLUMNS_OF_PAIRS if name in pairs.names and name not in lawless]
    columns = pairs.read(names_read)
    # programs write the vector from j to i and the forces on i; in Contacts the vector leads from i
    # to j and the forces act on j: all change their signs
    vectors: dict[str, Any] = {}
    for field, names in _VECTORS.items():
        if set(names) <= set(names_read):
            unit = scales.length if field == "vector" else scales.force
            vectors[field] = -unit * join_vectors(columns, names)
    if "twist" in names_read:
        # LAMMPS counts the torque on i along the vector from j to i. That on j is the opposite one
        # along the opposite vector, so that the number is the same.
        vectors["twisting_torque"] = scales.force * scales.length * columns["twist"]
    return Contacts(
        pairs.name,
        read_ids(pairs, "i", columns),
        read_ids(pairs, "j", columns),
        normal_force=scales.force * columns["force"] if "force" in columns else None,
        overlap=scales.length * columns["delta"] if "delta" in columns else None,
        lines=pairs.first + 1 + np.arange(pairs.count),
        **vectors,
        **springs.of(pairs.count),
    )


def list_lawless(pairs: Frame, springs: Springs) -> dict[str, str]:
    """Return the columns of static torques in a dump of ``pairs`` for which the ``springs`` have no
    law of rolling or twisting, each with the argument that would give one.

    LAMMPS does not set the rolling force and the torque of twist where no such law acts: it then
    writes what stands in its memory (``PairGranular::single``).
    """
    lawless: dict[str, str] = {}
    if springs.rolling is None:
        lawless |= dict.fromkeys(_VECTORS["rolling_force"], "rolling_stiffness")
    if springs.twisting is None:
        lawless["twist"] = "twisting_stiffness"
    return {name: argument for name, argument in lawless.items() if name in pairs.names}


def note_pairs(pairs: Frame, springs: Springs) -> list[str]:
    """Return the notes on columns of a dump of ``pairs`` that are not read: first on those of no
    known name, "" if there are none, and then on those without a law.
    """
    notes = [note_columns(pairs, COLUMNS_OF_PAIRS)]
    lawless = list_lawless(pairs, springs)
    for argument in dict.fromkeys(lawless.values()):
        names = [name for name in lawless if lawless[name] == argument]
        notes.append(
            f"{pairs.name}: not read without {argument}, as programs leave any numbers there where"
            f" no such law acts: {list_names(names)}."
        )
    return notes


def read_names(columns: Any, contact_frame: Frame) -> tuple[str, ...]:
    """Return the names of the columns of pairs from ``columns``, a list or a text of words;
    InputError unless there is one name for each column of the dump, and for two columns of one name
    that is read.
    """
    words: object = columns.split() if isinstance(columns, str) else columns
    names = tuple(words) if isinstance(words, Sequence) else ()
    are_texts = all(isinstance(name, str) for name in names)
    if are_texts and len(names) == len(contact_frame.names):
        for name in COLUMNS_OF_PAIRS:
            if names.count(name) > 1:
                fault = f"columns name {name} twice: {brief(columns)}"
                raise InputError(fault, "One alone can be read", "Give the other another name")
        return names
    shown = (
        f"{contact_frame.name} has {len(contact_frame.names)}: {list_names(contact_frame.names)}"
    )
    mend = f"Give a name for each; those that count are {', '.join(COLUMNS_OF_PAIRS)}"
    raise InputError(f"columns are {brief(columns)}, and {shown}", mend=mend)


# -- atoms -----------------------------------------------------------------------------------------


def read_balls(atoms: Frame, scales: Scales, frozen: Mapping[str, Any] | None) -> Balls:
    """Return the balls of a dump of atoms, in SI units.

    Balls that :func:`find_frozen` finds do not move, and neither do balls of infinite mass. The
    kinds are the elements, or else the types, if there are several. InputError without columns of
    places, ids or sizes, for ids that are no whole numbers, and as :func:`find_frozen`.
    """
    names = _name_places(atoms)
    has_radius = "radius" in atoms.names
    # without both columns the error is about the radius
    size_name = "radius" if has_radius or "diameter" not in atoms.names else "diameter"
    require_columns(atoms, ("id", size_name), _ADVICE_ON_ATOMS)
    has_mass = "mass" in atoms.names
    columns = atoms.read(["id", size_name, *names, *(["mass"] if has_mass else [])])
    positions, rounding = _find_positions(atoms, names, columns)
    radii = columns[size_name] if has_radius else 0.5 * columns[size_name]
    kinds = _read_kinds(atoms)
    return Balls(
        atoms.name,
        scales.length * positions,
        scales.length * radii,
        masses=scales.mass * columns["mass"] if has_mass else None,
        labels=read_ids(atoms, "id", columns),
        rounding=scales.length * rounding,
        radius_rounding=scales.length * find_rounding(radii),
        kinds=kinds if len(set(kinds)) > 1 else None,
        still=None if frozen is None else find_frozen(atoms, frozen),
        lines=atoms.first + 1 + np.arange(atoms.count),
    )


def _name_places(atoms: Frame) -> tuple[str, ...]:
    """Return the names of the three columns of places; InputError without such columns."""
    for suffix in _PLACE_SUFFIXES:
        names = tuple(f"{axis}{suffix}" for axis in "xyz")
        if set(names) <= set(atoms.names):
            return names
    listed = f"Its columns are {list_names(atoms.names)}"
    raise InputError(f"{atoms.name} has no columns x, y and z", listed, _ADVICE_ON_ATOMS)


def _find_positions(
    atoms: Frame, names: tuple[str, ...], columns: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Return the positions (n, 3) of balls, and the greatest errors (n, 3) that rounding leaves in
    them, both in units of the dump.

    ``names`` are the three of the ``columns`` that have the places, see :func:`_name_places`.
    """
    coordinates = join_vectors(columns, names)
    rounding = find_rounding(coordinates)
    if names[0].startswith("xs"):  # fractions of the box
        return coordinates @ atoms.cell + atoms.origin, rounding @ np.abs(atoms.cell)
    return coordinates, rounding


def _read_kinds(atoms: Frame) -> tuple[str, ...]:
    """Return the elements of balls, or else their types, a name for each ball (n,); an empty tuple
    if the dump has neither column.
    """
    for name in ("element", "type"):
        if name in atoms.names:
            return atoms.read_words(name)
    return ()


def find_frozen(atoms: Frame, frozen: Any) -> Flags:
    """Return (n,) whether each ball does not move: ``frozen`` maps names of columns to a value or
    several, as a list, a set or an array, and a ball that has one of the values in such a column is
    frozen.

    InputError for what is no such mapping, for an unknown column, for a column without a value, and
    for a value that no ball has.
    """
    if not isinstance(frozen, Mapping) or not frozen:
        mend = "Give a column of the dump with the values there: frozen={'type': 2}"
        raise InputError(f"frozen is {brief(frozen)}", mend=mend)
    is_frozen = np.zeros(atoms.count, bool)
    for column, given_values in frozen.items():
        require_columns(atoms, (str(column),), "Give a column that it has")
        is_array = isinstance(given_values, np.ndarray | np.generic)
        values = given_values.tolist() if is_array else given_values
        is_single = isinstance(values, str | bytes | Mapping) or not isinstance(values, Collection)
        words = np.array(atoms.read_words(column))
        if not is_single and not values:
            fault = f"frozen names no value of the column {column}"
            raise InputError(fault, "It would freeze nothing", "Give a value, or leave frozen out")
        for value in [values] if is_single else values:
            is_whole = isinstance(value, float) and value.is_integer()  # 2.0 stands there as 2
            has_value = words == str(int(value) if is_whole else value)
            if not np.any(has_value):
                raise InputError(f"{atoms.name} has no ball with {column} = {brief(value)}")
            is_frozen |= has_value
    return is_frozen


# -- walls -----------------------------------------------------------------------------------------


def _read_walls(walls: Any) -> tuple[str, ...]:
    """Return the names of walls, from one name or a list of names; InputError for anything else,
    and for a name that is given twice.
    """
    names = texts("walls", walls)
    for place, name in enumerate(names):
        if name in names[:place]:
            raise InputError(f"walls name {brief(name)} twice", "Its contacts would count twice")
    return names


def _list_own_walls(atoms: Frame) -> tuple[str, ...]:
    """Return the names of the walls in a dump of ``atoms`` of granphon's own; none of others."""
    return tuple(name for name in atoms.options.get(_WALLS, "").split(",") if name)


def _read_wall(
    atoms: Frame, balls: Balls, wall: str, label: int, scales: Scales, springs: Springs
) -> Contacts:
    """Return the contacts of ``balls`` with a wall, in SI units; the wall has the ``label``. Body i
    of each contact is the ball, and body j the wall.

    The contacts are in the columns of the ``fix wall/gran`` with the name ``wall`` and the keyword
    contacts: column 1 is not zero for balls that touch, columns 2 to 4 are the force on the ball,
    and columns 5 to 7 the place of the contact on the wall. InputError without these columns.
    """
    touching_name = f"f_{wall}[1]"
    force_names = [f"f_{wall}[{number}]" for number in _WALL_FORCE]
    place_names = [f"f_{wall}[{number}]" for number in _WALL_PLACE]
    names = [touching_name, *force_names, *place_names]
    mend = f"Add contacts to fix {wall}, and f_{wall}[*] to the columns of the dump"
    require_columns(atoms, names, mend)
    columns = atoms.read(names)
    rows = np.flatnonzero(columns[touching_name])
    force = join_vectors(columns, force_names)[rows]
    places = join_vectors(columns, place_names)[rows]
    axes = np.flatnonzero(atoms.pbc)
    with np.errstate(all="ignore"):  # a place out of range makes a normal of nan, told as a fault
        between = scales.length * places - balls.positions[rows]
        if axes.size:  # the contact may be at another image of the ball, if balls are not wrapped
            periods = scales.length * atoms.cell[axes]
            between -= np.rint(between @ np.linalg.pinv(periods)) @ periods
        distance = np.linalg.norm(between, axis=1)
        normal = between / distance[:, None]
    overlap = balls.radii[rows] - distance
    # LAMMPS lets forces of walls act at the radius, without half of the overlap
    reduction = np.zeros(len(rows))
    if atoms.options.get(_WALL_ARMS) == _AMID_OVERLAP:
        reduction = 0.5 * overlap
    assert balls.labels is not None
    return Contacts(
        f"{atoms.name}, wall {wall}",
        balls.labels[rows],
        np.full(len(rows), label),
        normal=normal,
        force=-scales.force * force,
        overlap=overlap,
        arm_i=balls.radii[rows] - reduction,
        arm_j=-reduction,
        lines=atoms.first + 1 + rows,
        **springs.of(len(rows)),
    )


def add_wall(balls: Balls, label: int, kind: str) -> Balls:
    """Return the ``balls`` with one more body at their end, a flat wall of this ``label`` and
    ``kind``: it has an infinite radius, and does not move.
    """
    n_axes = balls.positions.shape[1]
    still = np.zeros(len(balls.radii), bool) if balls.still is None else balls.still

    def extend(values: Any, value_of_wall: float) -> Any:
        """Return the values (n,) of balls with that of the wall at their end; None stays None."""
        return None if values is None else np.append(values, value_of_wall)

    return Balls(
        balls.name,
        np.append(balls.positions, np.zeros((1, n_axes)), axis=0),
        np.append(balls.radii, np.inf),
        rounding=np.append(balls.rounding, np.zeros((1, n_axes)), axis=0),
        radius_rounding=np.append(balls.radius_rounding, 0.0),
        masses=extend(balls.masses, np.inf),
        inertias=extend(balls.inertias, np.inf),
        labels=extend(balls.labels, label),
        kinds=None if balls.kinds is None else (*balls.kinds, kind),
        still=np.append(still, True),
        lines=extend(balls.lines, 0),
    )


# -- columns ---------------------------------------------------------------------------------------


def require_columns(frame: Frame, names: Sequence[str], mend: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless a frame has columns of these
    ``names``; the message has the advice ``mend``.
    """
    missing_names = [name for name in names if name not in frame.names]
    if missing_names:
        fault = f"{frame.name} has no column {' and no column '.join(missing_names)}"
        raise InputError(fault, f"Its columns are {list_names(frame.names)}", mend)


def join_vectors(columns: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return the columns of these m ``names`` side by side, (rows, m)."""
    return np.stack([columns[name] for name in names], axis=1)


def read_ids(frame: Frame, column: str, columns: Mapping[str, Array]) -> Index:
    """Return the whole numbers (rows,) of a ``column``, which are floats in ``columns``.

    InputError, with the line, for a number that is not whole, or too large to be exact.
    """
    numbers = columns[column]
    is_whole = (np.abs(numbers) < 2.0**53) & (numbers == np.rint(numbers))  # False for nan
    if not np.all(is_whole):
        row = int(np.argmin(is_whole))
        where = f"{frame.name}:{frame.first + 1 + row}: {column}"
        raise InputError(f"{where}: found {numbers[row]:.17g} where a whole number is needed")
    return np.asarray(numbers, np.intp)


def note_columns(frame: Frame, names_read: Collection[str]) -> str:
    """Return a note that names the columns of a frame that are not among ``names_read``, those of
    the columns that are read; "" if there are no such columns.
    """
    names = [name for name in frame.names if name not in names_read]
    if not names:
        return ""
    listed = list_names(names)
    return f"{frame.name}: not read, as the reader takes nothing from them: {listed}."


def note_atoms(atoms: Frame, walls: Collection[str], frozen: Mapping[str, Any] | None) -> list[str]:
    """Return the notes on columns of a dump of atoms that are not read: first on those of walls,
    and last on all others, "" if there are none.

    ``walls`` are the names of the fixes whose columns are read as contacts with walls, and
    ``frozen`` has the names of further columns that are read (:func:`find_frozen`). The columns of
    another fix that seem to be contacts with a wall have a note of their own, which says how to
    read them.
    """
    places = [f"{axis}{suffix}" for axis in "xyz" for suffix in _PLACE_SUFFIXES]
    names_read = {*_COLUMNS_OF_ATOMS, *places, *(frozen or ())}
    notes = []
    fixes: dict[str, set[int]] = {}  # the numbers of the columns of each fix
    for name in atoms.names:
        match = re.fullmatch(r"f_(.+)\[(\d+)\]", name)
        if match:
            fixes.setdefault(match[1], set()).add(int(match[2]))
    for fix, numbers in fixes.items():
        # fix wall/gran with the keyword contacts has the columns 1 to 8, of which 1 to 7 are needed
        has_contacts = set(range(1, 8)) <= numbers
        if has_contacts and fix not in walls:
            notes.append(
                f"{atoms.name}: contacts with the wall of fix {fix} are not read:"
                f" walls={fix!r} reads them."
            )
        if has_contacts:
            names_read |= {f"f_{fix}[{number}]" for number in numbers}
    return [*notes, note_columns(atoms, names_read)]


# -- writing ---------------------------------------------------------------------------------------


def write_dumps(network: Any, atoms: str | os.PathLike[str], pairs: str | os.PathLike[str]) -> None:
    """Write a network as a dump of atoms and one of pairs, and warn of what these leave out; see
    :meth:`~granphon.networks.network.ContactNetwork.write_dumps`.
    """
    for path in (atoms, pairs):
        require_path(path)
    if network.labels is not None:
        require_readable_labels(network.labels)
    box = _write_box(network)
    ids = np.arange(1, network.n_balls + 1) if network.labels is None else network.labels
    walls = _find_walls(network)
    _require_free_labels(ids[np.isfinite(network.radii)], len(walls))
    options = {name: str(getattr(network, name)) for name in (*_FIELDS_OF_NETWORK, _PRESTRESS)}
    if walls:
        options[_WALLS] = ",".join(walls)
        at_radius = network.arm_i == network.radii[network.i]
        if not np.all(at_radius[np.isinf(network.radii[network.j])]):
            options[_WALL_ARMS] = _AMID_OVERLAP
    columns_of_atoms = _list_columns_of_atoms(network, ids, walls)
    columns_of_pairs = _list_columns_of_pairs(network, ids)
    text_of_atoms = _frame_text("ATOMS", box, columns_of_atoms, options)
    text_of_pairs = _frame_text("ENTRIES", box, columns_of_pairs, options)
    write_texts([(atoms, text_of_atoms), (pairs, text_of_pairs)])
    _warn_of_lost(network)


def _require_free_labels(ids: Index, n_walls: int) -> None:
    """Raise InputError if one of the ``ids`` (n,) of balls is a label that the reader of dumps
    gives to one of ``n_walls`` walls: -1, -2, and so on.
    """
    is_taken = (ids < 0) & (ids >= -n_walls)
    if np.any(is_taken):
        raise InputError(
            f"a ball of the network has the label {ids[is_taken][0]}",
            "A wall has this label where dumps are read",
            "Give others: dataclasses.replace(network, labels=...)",
        )


def _list_columns_of_atoms(
    network: Any, ids: Index, walls: Mapping[str, Index]
) -> dict[str, Array]:
    """Return the columns (atoms,) of the dump of atoms by name, SI; flat walls are no atoms.

    ``ids`` (n,) are those of all bodies, and ``walls`` the contacts of each fix
    (:func:`_find_walls`).
    """
    kinds = network.kinds or [""] * network.n_balls
    _names, types = np.unique(kinds, return_inverse=True)
    force = np.zeros(network.n_balls)  # sums of the normal forces on each ball
    for end in (network.i, network.j):
        np.add.at(force, end, network.normal_force)
    columns: dict[str, Any] = {"id": ids, "type": types + 1}
    columns |= zip("xyz", network.positions.T, strict=True)
    columns |= {"radius": network.radii, "mass": network.masses, "force": force}
    for name, contacts in walls.items():
        columns |= _write_wall(network, name, contacts)
    is_ball = np.isfinite(network.radii)
    return {name: values[is_ball] for name, values in columns.items()}


def _list_columns_of_pairs(network: Any, ids: Index) -> dict[str, Array]:
    """Return the columns (pairs,) of the dump of pairs by name, SI, without contacts with flat
    walls; ``ids`` (n,) are those of all bodies.
    """
    normal_force, tangential_force = network.static_forces
    columns: dict[str, Any] = {"i": ids[network.i], "j": ids[network.j], "force": normal_force}
    # a dump has the vector from j to i, and the force on i
    columns |= zip(_VECTORS["vector"], -network.vector.T, strict=True)
    if network.tangential_force is not None:
        columns |= zip(_VECTORS["tangential_force"], -tangential_force.T, strict=True)
    if network.contact_torque is not None:
        columns |= _write_torques(network)
    joins_balls = np.isfinite(network.radii[network.j])  # a flat wall is always ball j
    return {name: values[joins_balls] for name, values in columns.items()}


def _find_walls(network: Any) -> dict[str, Index]:
    """Return the contacts of balls with flat walls as those of fixes with the keyword contacts: for
    the name of each fix the indices of its contacts, of which a ball has one at most.

    A wall that touches a ball several times, as the corner of a box, is in several fixes.
    """
    is_ball = np.isfinite(network.radii)
    contacts = np.flatnonzero(is_ball[network.i] & ~is_ball[network.j])
    balls = network.i[contacts]
    walls = network.j[contacts]
    contacts = contacts[np.lexsort((balls, walls))]
    ends = np.stack([network.j[contacts], network.i[contacts]], axis=1)
    # the contacts of one wall with one ball follow each other, and are counted from 0
    _ends, starts, inverse = np.unique(ends, axis=0, return_index=True, return_inverse=True)
    ranks = np.arange(len(contacts)) - starts[inverse.ravel()]
    keys = np.stack([ends[:, 0], ranks], axis=1)  # a fix has the contacts of one wall and rank
    fixes = np.unique(keys, axis=0)
    return {
        f"wall{number}": contacts[np.all(keys == fix, axis=1)]
        for number, fix in enumerate(fixes, 1)
    }


def _write_wall(network: Any, name: str, contacts: Index) -> dict[str, Array]:
    """Return the columns (n,) of a fix of this ``name`` with the keyword contacts, for all bodies.
    They say whether a body touches the wall, and have the force on the body, N, the place of the
    contact, m, and the radius of the body, m, all zero for bodies that do not touch the wall.

    ``contacts`` are the indices (m,) of the contacts with the wall.
    """
    balls = network.i[contacts]
    normal = network.normal[contacts]
    normal_force, tangential_force = network.static_forces
    stiffness = network.normal_stiffness[contacts]
    arms = network.arm_i[contacts] + network.arm_j[contacts]
    # arms that are the radii say nothing of the overlap, which is then that of the force
    distance = np.where(
        arms == network.radii[balls],
        arms - overlap_from(network.normal_force[contacts], stiffness),
        arms,
    )
    rows = np.zeros((network.n_balls, 8))
    rows[balls, 0] = 1.0
    rows[balls, 1:4] = -normal_force[contacts, None] * normal - tangential_force[contacts]
    rows[balls, 4:7] = network.positions[balls] + distance[:, None] * normal
    rows[balls, 7] = network.radii[balls]
    return {f"f_{name}[{number}]": column for number, column in enumerate(rows.T, 1)}


def _warn_of_lost(network: Any) -> None:
    """Warn, once, of the numbers of a network that dumps leave out and that change its modes: of
    stiffnesses that are not of one material, with their scatter, as others follow from the
    material; and of those that :meth:`~granphon.networks.network.ContactNetwork.write_dumps` names.
    """
    is_at_wall = np.isinf(network.radii[network.j])
    losses = list[str]()
    if network.ball_motions.rotate:
        balls = np.flatnonzero(network.moving)
        solid_inertias = SOLID_INERTIA * network.masses[balls] * network.radii[balls] ** 2
        deviations = np.abs(network.inertias[balls] - solid_inertias)
        if np.any(deviations > _SPRING_TOLERANCE * solid_inertias):
            losses.append("moments of inertia, which are not those of solid balls")
    if network.contact_torque is not None and np.any(network.contact_torque[is_at_wall]):
        losses.append("static torques of contacts with flat walls")
    if network.on_site is not None:
        losses.append("springs to the ground")
    if network.adhesive:
        n_pulling = np.count_nonzero(network.normal_force < 0.0)
        losses.append(
            "that contacts adhere, so that those which pull are refused where dumps are read"
            f" ({n_pulling:,} of {network.n_contacts:,})"
        )
    scatter = _find_scatter(network)
    if scatter > _SPRING_TOLERANCE:
        losses.append(
            "stiffnesses, which are not of one material by Hertz's and Mindlin's laws, and differ"
            f" from such by up to {100.0 * scatter:.3g} %"
        )
    if losses:
        fault = f"the dumps leave out {'; and '.join(losses)}"
        why = "The network that is read from them has other modes"
        mend = "Write tables, which keep all: network.write_tables, as CSV or extended XYZ"
        warn_caller(message(fault, why, mend), InconsistencyWarning)


def _find_scatter(network: Any) -> float:
    """Return the greater of two scatters of the contacts of the balls of a network, each the
    greatest number over the least, less one.

    The first is of normal stiffnesses over those that one material gives by Hertz's law under the
    same forces, or of the normal stiffnesses themselves, as of a linear law, whichever is less. The
    second is of the ratios of shear and normal stiffness.
    """
    has_ball = np.isfinite(network.radii[network.i])  # contacts of two flat walls are not written
    force = network.normal_force[has_ball]
    normal_stiffness = network.normal_stiffness[has_ball]
    curvature = (1.0 / network.radii[network.i] + 1.0 / network.radii[network.j])[has_ball]
    is_pressed = force > 0.0
    # the coefficients of one material go as the roots of the reduced radii; the unit of the moduli
    # that follow plays no part in their scatter
    coefficient = 1.0 / np.sqrt(curvature[is_pressed])
    unit_law = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
    overlap = unit_law.overlap(force[is_pressed] / coefficient)
    stiffness_of_law = coefficient * unit_law.stiffness(overlap)
    moduli = normal_stiffness[is_pressed] / stiffness_of_law
    ratios = network.shear_stiffness[has_ball] / normal_stiffness
    normal_scatter = min(_find_spread(moduli), _find_spread(normal_stiffness))
    # without friction all ratios are zero
    shear_scatter = _find_spread(ratios) if np.any(ratios) else 0.0
    return max(normal_scatter, shear_scatter)


def _find_spread(values: Array) -> float:
    """Return the greatest of some ``values`` (m,), zero or above, over the least, less one; inf if
    the least is zero, and zero without values.
    """
    if not values.size:
        return 0.0
    least = float(np.min(values))
    return float(np.max(values)) / least - 1.0 if least > 0.0 else np.inf


def _write_torques(network: Any) -> dict[str, Any]:
    """Return the columns of the rolling forces on balls i, N, and of the torques of twist, N m, of
    which the static torques of contacts consist.
    """
    torque = network.contact_torque
    curvature = 1.0 / network.radii[network.i] + 1.0 / network.radii[network.j]
    rolling = -curvature[:, None] * np.cross(network.normal, torque)
    twist = np.einsum("ca,ca->c", torque, network.normal)
    return dict(zip(("rx", "ry", "rz"), rolling.T, strict=True)) | {"twist": twist}


def _write_box(network: Any) -> str:
    """Return the lines of a dump that give the box of a network. Along a period the box begins at
    the origin and is the cell. Along another axis it lies along x, y or z, and is as long as is
    needed to contain all balls between its sides, which the periods tilt.

    Raises InputError for a cell that no box of a dump can be: the first vector of the cell must lie
    along x, the second in the xy plane, and each must lead upwards along its own axis.
    """
    cell = network.cell.copy()
    is_open = ~np.asarray(network.pbc)
    is_ball = np.isfinite(network.radii)
    places = network.positions[is_ball]
    cell[is_open] = np.eye(3)[is_open]
    if np.any(np.triu(cell, 1)) or not np.all(np.diag(cell) > 0.0):
        fault = f"the cell of the network is {network.cell.tolist()} m"
        why = (
            "In a dump the first vector lies along x, the second in the xy plane, and each leads"
            " upwards along its own axis"
        )
        raise InputError(fault, why, "Turn the network, or write tables: network.write_tables")
    inverse = np.linalg.inv(cell)
    # coordinates along the sides of the box, in m along open axes, and how far radii reach
    coordinates = places @ inverse
    reach = network.radii[is_ball, None] * np.linalg.norm(inverse, axis=0)
    low = np.where(is_open, np.min(coordinates - reach, axis=0), 0.0)
    sides = np.max(coordinates + reach, axis=0) - low
    cell[is_open] = np.diag(sides)[is_open]
    xy, xz, yz = cell[1, 0], cell[2, 0], cell[2, 1]
    # the bounds of a tilted box are those of the orthogonal box around it
    rows = np.stack([low, low + np.diag(cell)], axis=1)
    rows[0] += min(0.0, xy, xz, xy + xz), max(0.0, xy, xz, xy + xz)
    rows[1] += min(0.0, yz), max(0.0, yz)
    heading = " ".join("pp" if repeats else "ff" for repeats in network.pbc)
    if xy or xz or yz:
        heading = f"xy xz yz {heading}"
        rows = np.hstack([rows, [[xy], [xz], [yz]]])
    return "\n".join([f"ITEM: BOX BOUNDS {heading}", *map(join_numbers, rows.tolist())])


def _frame_text(
    kind: str, box: str, columns: Mapping[str, Array], options: Mapping[str, str]
) -> str:
    """Return the text of a dump of one time step with the number 0 and the lines ``box``;
    ``kind`` is "ATOMS" or "ENTRIES", and ``columns`` have the numbers (rows,) by name, in SI units.
    The line of the units names granphon, so that a later dump of granphon may replace the file, and
    has the ``options`` of the network.
    """
    rows = list(zip(*(values.tolist() for values in columns.values()), strict=True))
    head = [
        "ITEM: UNITS",
        " ".join([f"si{OWN_MARK}", *(f"{name}={value}" for name, value in options.items())]),
        "ITEM: TIMESTEP",
        "0",
        f"ITEM: NUMBER OF {kind}",
        str(len(rows)),
    ]
    head += [box, f"ITEM: {kind} {' '.join(columns)}"]
    return "\n".join([*head, *map(join_numbers, rows), ""])
