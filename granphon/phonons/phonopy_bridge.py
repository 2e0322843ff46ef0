"""The Phonopy object for balls in contact, and its files.

The coordinates of phonopy's atoms hold the motions of balls
(:mod:`granphon.phonons.phonopy_atoms`), in the plane (u_x, u_y, w) with w = R_g phi. A translation
of the lattice does not change w, and rotations and reflections act on w as on an axial vector.
Methods that symmetrise force constants, or enforce their sum rule, are therefore wrong here.
:class:`ContactPhonopy` refuses them, and exported files are made such that they do no harm.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from phonopy import Phonopy
from phonopy.physical_units import get_physical_units
from phonopy.structure.atoms import PhonopyAtoms

from granphon.balls.motions import Motions
from granphon.base.arrays import Array
from granphon.base.errors import InputError, UnsupportedError
from granphon.base.scales import HertzPrefix, Units, read_header
from granphon.base.staging import write_text
from granphon.base.text import (
    fill_floats,
    plain_yaml,
    read_sealed,
    require_own_file,
    seal,
    versions,
    warn_unverified,
    write_float,
)
from granphon.phonons.phonopy_atoms import (
    free_symbol,
    make_header,
    name_atoms,
    read_kinds,
    read_motions,
    read_numbers,
    write_kinds,
)

_SYMMETRY = (
    "it imposes the sum rule or the space group of translations, and some coordinates are rotations"
)
_DATASET = (
    "it replaces the force constants by those of displaced supercells, and here they come from"
    " the contacts"
)
_QUANTA = "it takes frequencies for THz and rotations for displacements of atoms"
_VOLUME = (
    "it takes the path and the mesh from the symmetry of a crystal of atoms; use Phonons.bands or"
    " Phonons.dos"
)
_FIXED = (
    "force constants, masses and group velocities belong together; make another Phonons(state,"
    " atoms)"
)
_CHARGE = "balls carry no charge"
_FILE = (
    "phonopy symmetrises what it reads from such a file, and the rotational branch falls to zero;"
    " use Phonons.save"
)
_UNGUARDED = (
    "its copy would lose these guards and the force constants; make another Phonons(state, atoms)"
)

#: patterns of the names of methods of phonopy.Phonopy that would give a wrong answer for balls,
#: each with the reason
_REASONS = (
    (r"^symmetrize_|irreps", _SYMMETRY),
    (r"^(generate_displacements|produce_force_constants)$|_mlp$", _DATASET),
    (
        r"thermal|random_displacements|dynamic_structure_factor|modulat|animation|^set_Debye",
        _QUANTA,
    ),
    (r"^auto_", _VOLUME),
    (r"^(save|to_phonopy_yaml)$", _FILE),
    (
        r"^get_Debye",
        "it counts three branches of sound for each atom in space; rotations and a layer have"
        " others",
    ),
    (
        r"moment$",
        "it drops modes of negative frequency, so that modes at zero count or not as rounding"
        " has it",
    ),
    (r"^set_force_constants_zero", _FIXED),
    (r"^(copy|replicate|ph2ph)$", _UNGUARDED),
)
#: reasons by the names of methods of the installed phonopy.Phonopy that would give a wrong answer
#: for balls, or read the results of such methods
REFUSED: dict[str, str] = {
    name: reason
    for name in dir(Phonopy)
    if name[0] != "_" and callable(getattr(Phonopy, name))
    for pattern, reason in _REASONS
    if re.search(pattern, name)
}
#: reasons by the names of attributes that may be read but not set
READ_ONLY: dict[str, str] = {
    **dict.fromkeys(
        ("dataset", "displacements", "forces", "supercell_energies", "mlp", "mlp_dataset"), _DATASET
    ),
    **dict.fromkeys(("force_constants", "masses"), _FIXED),
    "nac_params": _CHARGE,
}

#: factor by which exported force constants are multiplied, so that the fixed number of decimals
#: that phonopy writes keeps every digit; a power of two, which changes no digit
_EXPORT_SCALE = 2.0**30
#: symbol of the auxiliary atom of an export, see Phonons.save
_AUXILIARY = "He"
#: position of the auxiliary atom, fractions of the cell
_AUXILIARY_POSITION = (0.137, 0.291, 0.373)
#: mass of the auxiliary atom, in masses of a ball
_AUXILIARY_MASS = 1e32


def _refuse(name: str, reason: str) -> Any:
    """Return a method ``name`` that raises :class:`~granphon.base.errors.UnsupportedError` with a
    ``reason``, to stand in place of phonopy's.
    """

    def method(self: Any, *args: Any, **kwargs: Any) -> NoReturn:
        raise UnsupportedError(f"Phonopy.{name} is refused for balls in contact: {reason}")

    method.__name__ = name
    method.__doc__ = f"Raises UnsupportedError: {reason}."
    return method


class ContactPhonopy(Phonopy):  # type: ignore[misc]
    """A ``phonopy.Phonopy`` in reduced units, with frequencies in (k/M)^1/2. Its methods that would
    give a wrong answer for balls raise :class:`~granphon.base.errors.UnsupportedError`.
    """

    def give_force_constants(self, force_constants: Array) -> None:
        """Set the force constants (n, N, 3, 3), k, between the n atoms of the cell and the N of the
        supercell; they are read-only from then on.
        """
        Phonopy.force_constants.fset(self, force_constants)
        self.force_constants.setflags(write=False)


for _name, _reason in REFUSED.items():
    setattr(ContactPhonopy, _name, _refuse(_name, _reason))
READ_ONLY = {_name: _reason for _name, _reason in READ_ONLY.items() if hasattr(Phonopy, _name)}
for _name, _reason in READ_ONLY.items():
    _base = getattr(Phonopy, _name)
    setattr(
        ContactPhonopy,
        _name,
        property(_base.fget, _refuse(f"{_name} = ...", _reason), doc=_base.__doc__),
    )


def write_phonopy(
    bridge: ContactPhonopy,
    path: str | os.PathLike[str],
    scales: Units,
    top: float,
    motions: Motions,
    periods: int,
    kinds: Sequence[str] = (),
) -> None:
    """Write the force constants of ``bridge`` to the file ``path``, such that phonopy reads them
    correctly without options: with an auxiliary atom, as :meth:`Phonons.save` explains.

    ``scales`` convert reduced units to SI, and ``top`` is the highest frequency, Hz. ``motions``
    are those of each ball, ``kinds`` the kinds of the balls, if known, and ``periods`` is the
    number of periods of the lattice.
    """
    unit = HertzPrefix.for_top(top)
    # masses are such that a reader's "THz" are frequencies in the unit of the file
    per_frequency = scales.frequency / unit.hertz / get_physical_units().DefaultToTHz
    mass = _EXPORT_SCALE / per_frequency**2
    unit_cell = bridge.unitcell
    n = len(unit_cell)
    symbol = free_symbol(_AUXILIARY, unit_cell.symbols)
    # number of bands at zero that a reader sees besides the branches: three of the auxiliary atom,
    # and one for each coordinate that holds no motion
    zero_bands = 3 + n // motions.atoms_per_ball * len(motions.still_slots)
    cell = PhonopyAtoms(
        symbols=[*unit_cell.symbols, symbol],
        cell=unit_cell.cell,
        masses=np.append(unit_cell.masses, _AUXILIARY_MASS) * mass,
        scaled_positions=np.vstack([unit_cell.scaled_positions, _AUXILIARY_POSITION]),
    )
    export = Phonopy(
        cell, bridge.supercell_matrix, primitive_matrix="P", is_symmetry=False, log_level=0
    )
    numbers_in_supercell = [int(number) for number in export.primitive.p2s_map]
    constants = _couple_auxiliary(bridge.force_constants, numbers_in_supercell)
    export.force_constants = constants * _EXPORT_SCALE
    # phonopy writes physical units into the file unless this factor has been set; any setting will
    # do, also to its present value
    export.unit_conversion_factor = export.unit_conversion_factor
    head = [
        *make_header(unit, scales, motions, periods),
        f"  version: {versions()['granphon']}",
        f"  force_constants_scale: {write_float(_EXPORT_SCALE)}",
        f"  auxiliary_atom: {symbol}",
        f"  zero_bands: {zero_bands}",
        *write_kinds(kinds),
        "  masses:",
        *fill_floats("  - %r", unit_cell.masses[:, None].tolist()),
        "",
    ]
    body = str(export.to_phonopy_yaml(settings={"force_constants": True}))
    write_text(path, seal([*head, *body.removesuffix("\n").split("\n")]))


def _couple_auxiliary(constants: Array, firsts: list[int]) -> Array:
    """Return force constants (n + 1, N + N/n, 3, 3) with the auxiliary atom, from ``constants``
    (n, N, 3, 3) between the n atoms of the cell and the N of the supercell.

    The auxiliary atom is coupled to the atoms of its own cell such that the force constants of each
    atom add up to zero (the sum rule). ``firsts`` (n + 1,) are the numbers, in the supercell, of
    the atoms of the first cell, the auxiliary atom last; phonopy orders a supercell by atom, then
    by cell.
    """
    n, size = constants.shape[:2]
    *balls, auxiliary = firsts
    sums = constants.sum(axis=1)  # (n, 3, 3), which the auxiliary atom takes away
    coupled = np.zeros((n + 1, size + size // n, 3, 3))
    coupled[:n, :size] = constants
    coupled[:n, auxiliary] = -sums
    coupled[n, balls] = -sums.swapaxes(1, 2)
    coupled[n, auxiliary] = 0.5 * (sums.sum(axis=0) + sums.sum(axis=0).T)
    return coupled


def load_phonopy(path: str | os.PathLike[str]) -> tuple[ContactPhonopy, Units]:
    """Return the Phonopy object in reduced units, without the auxiliary atom, and the scales, from
    the file ``path``, which :meth:`Phonons.save` wrote.

    Only this file is read, as plain data; phonopy's own loader is not used.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : the file is none that :meth:`Phonons.save` wrote, its digest is not that of its
        text, or its numbers do not fit together.
    SchemaError : the file has another schema; an InputError too.

    Warns
    -----
    UnverifiedFileWarning : the file has no digest: a change is then noticed only where numbers no
        longer fit together.
    """
    text, is_verified = read_sealed(path)
    with require_own_file(path, "phonopy_params.yaml"):
        data = plain_yaml(text, path)
        _, scales = read_header(path, data["granphon"])
        bridge = _make_bridge(data)
    if not is_verified:
        warn_unverified(path)
    return bridge, scales


def _make_bridge(data: Any) -> ContactPhonopy:
    """Return the Phonopy object in reduced units, without the auxiliary atom, from the ``data`` of
    a file that :meth:`Phonons.save` wrote.

    Raises :class:`~granphon.base.errors.InputError` for data that do not fit together.
    """
    header = data["granphon"]
    scale = float(read_numbers("force_constants_scale", header["force_constants_scale"], ()))
    if scale <= 0.0:
        raise InputError("Its scale of force constants is not above zero")
    motions, periods = read_motions(header)
    cell = _read_cell(data["unit_cell"], header, motions)
    n = len(cell)
    numbers = _read_supercell(data["supercell_matrix"], periods)
    cells = math.prod(numbers)  # of Python's integers, whose product does not overflow
    constants = _read_constants(data["force_constants"], n + 1, cells)
    bridge = ContactPhonopy(
        cell, np.diag(numbers), primitive_matrix="P", is_symmetry=False, log_level=0
    )
    bridge.unit_conversion_factor = 1.0
    # the auxiliary atom, last in the cell and in the supercell, is left out
    bridge.give_force_constants(constants[:n, : len(bridge.supercell)] / scale)
    return bridge


def _read_cell(unit_cell: Any, header: Any, motions: Motions) -> PhonopyAtoms:
    """Return the cell of the atoms that hold the ``motions`` of balls, without the auxiliary atom,
    from the block ``unit_cell`` and the ``header`` of a file.

    Raises :class:`~granphon.base.errors.InputError` for other atoms, and for a mass that is not
    above zero.
    """
    masses = read_numbers("masses", header["masses"], (-1,))
    n = len(masses)
    atoms = unit_cell["points"]
    symbols = [atom["symbol"] for atom in atoms]
    per_ball = motions.atoms_per_ball
    # the last of the symbols is that of the auxiliary atom
    kinds = read_kinds(header, symbols[:-1:per_ball])
    ball_symbols = name_atoms(masses[::per_ball], motions, kinds)
    expected_symbols = [*ball_symbols, free_symbol(_AUXILIARY, ball_symbols)]
    if not n or len(atoms) != n + 1 or symbols != expected_symbols:
        raise InputError("Its cell does not consist of balls and the auxiliary atom")
    if np.any(masses <= 0.0):
        raise InputError("Its masses are not above zero")
    positions = read_numbers("coordinates", [atom["coordinates"] for atom in atoms[:n]], (n, 3))
    vectors = read_numbers("lattice", unit_cell["lattice"], (3, 3))
    return PhonopyAtoms(
        symbols=symbols[:n], cell=vectors, masses=masses, scaled_positions=positions
    )


def _read_supercell(listed: Any, periods: int) -> list[int]:
    """Return the numbers of cells (3,) of a supercell from its matrix, ``listed`` in a file.

    Raises :class:`~granphon.base.errors.InputError` unless the matrix is diagonal, with whole
    numbers of cells along the ``periods`` and one cell across. granphon writes no other matrix, and
    with others phonopy may run without end.
    """
    matrix = np.array(listed)
    is_matrix = matrix.shape == (3, 3) and matrix.dtype.kind == "i"
    numbers = np.diag(matrix).tolist() if is_matrix else [0]
    is_diagonal = np.array_equal(matrix, np.diag(numbers))
    are_counts = min(numbers) >= 1 and all(number == 1 for number in numbers[periods:])
    if not (is_diagonal and are_counts):
        names = ["n1", "n2", "n3"][:periods] + ["1"] * (3 - periods)
        raise InputError(f"Its supercell_matrix is not that of {' x '.join(names)} cells")
    return numbers


def _read_constants(block: Any, atoms: int, cells: int) -> Array:
    """Return the force constants (``atoms``, ``atoms`` * ``cells``, 3, 3) of a ``block`` of a file:
    between the atoms of a cell and those of a supercell.

    Raises :class:`~granphon.base.errors.InputError` for a block of other numbers.
    """
    rows, columns = block["shape"]
    if columns != atoms * cells or rows not in (atoms, columns):
        raise InputError(
            f"Its force constants of shape {block['shape']} do not fit {cells} cells of {atoms}"
            f" atoms"
        )
    elements = read_numbers("elements", block["elements"], (rows * columns, 3, 3))
    constants = elements.reshape(rows, columns, 3, 3)
    if rows != atoms:
        # the block has the rows of all cells. Phonopy orders a supercell by atom, then by cell, so
        # every row of this step belongs to the first cell
        constants = constants[::cells]
    return constants
