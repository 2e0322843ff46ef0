"""The atoms, of three coordinates each, that hold the motions of balls in phonopy and its files.

Up to three motions of a ball fit into the coordinates x, y, z of one atom: (u_x, u_y, w_z) in the
plane, (w_x, w_y, u_z) out of it. Six motions need a second atom, which holds (w_x, w_y, w_z).
Phonopy refuses two atoms at one position, so the second atom is moved aside by a small offset. In
phonopy a wave has the phase exp(i q.r) at the position r of each atom. The eigenvector of the
second atom therefore lacks the factor exp(i q.offset) that it would have at its ball.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.lattices import BALL
from granphon.balls.motions import Motions, allowed_motions
from granphon.base.arrays import Array, Complex
from granphon.base.errors import InputError
from granphon.base.results import read_only
from granphon.base.scales import HertzPrefix, Units, file_header
from granphon.base.text import show

#: chemical symbol of the atoms that hold rotations alone
SPIN = "Sn"
#: chemical symbols of balls of different masses, in the order in which the masses first occur
KINDS = (BALL, "Al", "Cu", "Ti", "Zn", "W", "Pb", "Ni", "Ag", "Au", "Si", "Cr")
#: chemical symbol that YAML reads as false
_FALSE = "No"
#: symbols that are not chosen for a kind: those of other atoms, and that which YAML misreads
_NO_KIND = (SPIN, "He", _FALSE)
#: relative difference up to which two masses are one
_ONE_MASS = 1e-9
#: displacement of the atoms that hold rotations alone from the centres of the balls, in diameters:
#: so short that the nearest images of touching balls stay the same, and without symmetry
OFFSET: Array = read_only([0.0031, 0.0047, 0.0059])


def number_kinds(masses: Array) -> list[int]:
    """Return the number of the kind of each ball, from the ``masses`` (n,): balls of one mass are
    one kind, and kinds are numbered in the order in which their masses first occur.

    If there are more kinds than symbols in :data:`KINDS`, all balls are of kind 0.
    """
    masses_of_kinds: list[float] = []
    numbers = []
    for mass in masses.tolist():
        equal_kinds = [
            number
            for number, mass_of_kind in enumerate(masses_of_kinds)
            if abs(mass - mass_of_kind) <= _ONE_MASS * mass_of_kind
        ]
        if equal_kinds:
            numbers.append(equal_kinds[0])
            continue
        if len(masses_of_kinds) == len(KINDS):
            return [0] * len(masses)
        numbers.append(len(masses_of_kinds))
        masses_of_kinds.append(mass)
    return numbers


def free_symbol(symbol: str, taken: Iterable[str]) -> str:
    """Return a chemical symbol that is not among those ``taken``: ``symbol`` if possible, else one
    of :data:`KINDS`, else any other.
    """
    from ase.data import chemical_symbols  # imported here, as figures of bands do not need ASE

    taken_symbols = set(taken)
    candidates = (symbol, *KINDS, *chemical_symbols[1:])
    return next(str(candidate) for candidate in candidates if candidate not in taken_symbols)


def choose_symbols(kinds: Iterable[str]) -> dict[str, str]:
    """Return a dictionary of different chemical symbols by the names of ``kinds`` of balls.

    A kind whose name is a symbol has that symbol, but for "No", which YAML reads as false. A kind
    whose name begins with a symbol that no letter follows, as Al6061, has this symbol if no other
    kind has it, and if it is none of :data:`_NO_KIND`. Any other kind has a free symbol. If there
    are more kinds than symbols, all balls have one symbol.
    """
    from ase.data import chemical_symbols

    names = list(dict.fromkeys(kinds))
    elements = chemical_symbols[1:]  # the first is "X", which is no element
    if len(names) > len(elements) - len(_NO_KIND):
        return dict.fromkeys(names, BALL)
    symbols = {name: name for name in names if name in elements and name != _FALSE}
    beginnings = dict[str, str]()  # by name, where a name begins with a symbol
    for name in names:
        beginning = re.match(r"[A-Z][a-z]?(?![A-Za-z])", name)
        if beginning is not None and beginning[0] in elements:
            beginnings[name] = beginning[0]
    # names that begin with a symbol choose first
    for name in (*beginnings, *names):
        if name not in symbols:
            used_symbols = (*symbols.values(), *_NO_KIND)
            symbols[name] = free_symbol(beginnings.get(name, BALL), used_symbols)
    return {name: symbols[name] for name in names}


def name_symbols(kinds: Iterable[str]) -> dict[str, str]:
    """Return a dictionary whose keys are the chemical symbols of ``kinds`` of balls, and whose
    values are their names; it is empty without kinds, and if there are more kinds than symbols.
    """
    symbols = choose_symbols(kinds)
    names = {symbol: name for name, symbol in symbols.items()}
    return names if len(names) == len(symbols) else {}


def name_balls(masses: Array, kinds: Sequence[str] = ()) -> list[str]:
    """Return a chemical symbol for each of n balls: that of its kind among ``kinds`` (n,). Without
    kinds, or if there are more kinds than symbols, it is that of its mass among ``masses`` (n,),
    see :func:`number_kinds`.
    """
    symbol_of = {name: symbol for symbol, name in name_symbols(kinds).items()}
    if not symbol_of:
        return [KINDS[number] for number in number_kinds(masses)]
    return [symbol_of[kind] for kind in kinds]


def name_atoms(masses: Array, motions: Motions, kinds: Sequence[str] = ()) -> list[str]:
    """Return the chemical symbols of the one or two atoms that hold the ``motions`` of each ball,
    ball after ball, from the ``masses`` (n,) and ``kinds`` of the balls as in :func:`name_balls`.
    """
    balls = name_balls(masses, kinds)
    spin = free_symbol(SPIN, balls)
    return [symbol for ball in balls for symbol in (ball, spin)[: motions.atoms_per_ball]]


def write_kinds(kinds: Sequence[str]) -> list[str]:
    """Return the line of the head of a file that names the kind of balls of each symbol, as a list;
    an empty list without ``kinds``, and if there are more kinds than symbols.
    """
    names = name_symbols(kinds)
    return [f"  kinds: {json.dumps(names, ensure_ascii=False)}"] if names else []


def read_kinds(header: Mapping[str, Any], symbols: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the kinds of balls with these ``symbols``, from the ``header`` of a file;
    an empty tuple if the header names no kinds.
    """
    if "kinds" not in header:
        return ()
    return tuple(str(header["kinds"][symbol]) for symbol in symbols)


def place_in_space(vectors: Array, positions: Array) -> tuple[Array, Array]:
    """Return the vectors (3, 3) of a cell and the positions (n, 3) of its balls, in three
    dimensions, from the ``vectors`` (p, d) of its periods and the ``positions`` (n, d), all in
    diameters. Across the periods the cell is one diameter thick.
    """
    periods, dimension = vectors.shape
    cell = np.eye(3)
    cell[:periods] = 0.0
    cell[:periods, :dimension] = vectors
    positions_in_space = np.zeros((len(positions), 3))
    positions_in_space[:, :dimension] = positions
    return cell, positions_in_space


def place_atoms(positions: Array, motions: Motions, offset: Array = OFFSET) -> Array:
    """Return the positions (n_a, 3) of the one or two atoms that hold the ``motions`` of each ball,
    ball after ball, from the ``positions`` (n, 3) of the balls; all in the unit of ``offset`` (3,),
    by which a second atom is displaced from its ball.
    """
    steps = np.stack([np.zeros(3), offset])[: motions.atoms_per_ball]
    return np.asarray((positions[:, None] + steps).reshape(-1, 3))


def find_offset_phases(qpoints: Array, cell: Array) -> Complex:
    """Return the phases exp(i q.offset) (...) for ``qpoints`` (..., 3) in fractions of the
    reciprocal vectors of ``cell`` (3, 3), whose rows are in diameters.
    """
    return np.asarray(np.exp(2j * np.pi * (qpoints @ (OFFSET @ np.linalg.inv(cell)))))


# -- the head of files -----------------------------------------------------------------------------


def make_header(unit: HertzPrefix, scales: Units, motions: Motions, periods: int) -> list[str]:
    """Return the lines of the block ``granphon`` at the head of a file: the ``unit`` of
    frequencies, the ``scales``, the ``motions`` that the coordinates of the atoms of a ball hold,
    and the number of ``periods``.
    """
    return [
        *file_header(unit, scales, _name_coordinates(motions)),
        f"  periods: {periods}",
        f"  motions: {motions.name}",
        f"  rotations: {str(motions.rotate).lower()}",
    ]


def _name_coordinates(motions: Motions) -> list[str]:
    """Return, for each coordinate of the one or two atoms that hold the ``motions`` of a ball, the
    name of the motion that the coordinate holds; "0" if it holds none.
    """
    names = ["0"] * (3 * motions.atoms_per_ball)
    for slot, letter in zip(motions.slots, motions.letters, strict=True):
        names[slot] = f"{letter} = R_g phi{letter[1:]}" if letter.startswith("w") else letter
    return names


def read_motions(header: Mapping[str, Any], components: int | None = None) -> tuple[Motions, int]:
    """Return the motions of a ball and the number of periods from the ``header`` of a file, a block
    that :func:`make_header` wrote.

    ``components`` is the number of motions of a ball in the rest of the file, if it is known.
    Raises :class:`~granphon.base.errors.InputError` for a number of periods other than 1, 2 and 3,
    for motions that do not exist, for coordinates that are not those of the motions, and for
    another number of motions than ``components``.
    """
    periods = header["periods"]
    rotate = header["rotations"]
    motions_by_name = allowed_motions(1)
    if periods not in (1, 2, 3) or not isinstance(rotate, bool):
        raise InputError(
            "It does not say how many periods the lattice has, and whether balls rotate"
        )
    if header["motions"] not in motions_by_name:
        raise InputError(f"Its motions are none of {', '.join(motions_by_name)}")
    motions = motions_by_name[header["motions"]]
    if not rotate:
        motions = replace(motions, rotations=())
    coordinates = _name_coordinates(motions)
    if [str(coordinate) for coordinate in header["coordinates"]] != coordinates:
        raise InputError(f"Its coordinates of a ball are not {', '.join(coordinates)}")
    if components not in (None, motions.count):
        raise InputError(
            f"It has {components} motions for each ball, and its head says {motions.count}"
        )
    return motions, periods


def read_numbers(name: str, values: Any, shape: tuple[int, ...] | None = None) -> Array:
    """Return the ``values`` of a key of a file as an array of finite floats.

    If a ``shape`` is given, the array has this shape, in which -1 stands for any length. Raises
    :class:`~granphon.base.errors.InputError`, with the ``name`` of the key, for other values.
    """
    try:
        numbers = np.array(values)
    except (TypeError, ValueError):  # lists of different lengths
        raise InputError(f"Its values of {name} are not equally many everywhere") from None
    if numbers.dtype.kind not in "if":
        # the message shows the first value that is not a number
        leaves = np.array(values, object).ravel().tolist()
        other_values = [
            leaf for leaf in leaves if isinstance(leaf, bool) or not isinstance(leaf, int | float)
        ]
        if other_values:
            fault = f"It has {show(other_values[0])} under {name}, where a number is needed"
            raise InputError(fault)
        try:
            numbers = np.array(values, float)  # of whole numbers beyond 64 bits
        except OverflowError:
            raise InputError(f"It has too large a number under {name}") from None
    if not np.all(np.isfinite(numbers)):
        raise InputError(f"It has a number that is not finite under {name}")
    if shape is None:
        return numbers.astype(float)
    lengths = zip(shape, numbers.shape, strict=False)
    has_lengths = all(expected in (-1, length) for expected, length in lengths)
    if numbers.ndim != len(shape) or not has_lengths:
        raise InputError(f"Its values of {name} have the shape {numbers.shape} instead of {shape}")
    return numbers.astype(float)
