"""Balls as an ``ase.Atoms``: the meaning of its arrays, and the check that they belong to the given
state.

Atoms are in reduced units (d = k = M = 1). For conversion to SI, the scales are in ``atoms.info``
(see :class:`granphon.base.scales.Units`). ASE loses that dictionary in several places, so an array
guards against the units of another state. The arrays are:

``granphon_scales``      (N, 3) natural logarithms of d (m), k (N/m) and M (kg): a file with eight
                         decimals then keeps eight digits of each scale.
``granphon_kind``        (N,) 0: balls of a lattice; 1: of a lattice with finite overlap; 2: of a
                         simulated sample.
``diameter_deviations``  (N,) d_i - <d>.
``displacements``        (N, 3) displacements from the lattice sites; force constants depend on
                         these.
``slip_origin``          (N, 3) displacements at which, without rotation, no contact has slipped:
                         those of a sample at rest.
``rotations``            (N,) angle phi about z, rad, of balls that stay in a plane or on a line;
                         (N, 3) rotation vector phi, rad, of balls that move in space.
``radius``               (N,) radius d_i/2, for programs that draw balls.

All but the last are required, and so are masses: ASE gives a ball without a mass that of an iron
atom, and some of its readers store that mass.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.packing import Packing
from granphon.base.arrays import Array, Flags
from granphon.base.errors import InputError, brief, needing
from granphon.base.scales import Units
from granphon.base.staging import write_text
from granphon.base.text import require_path
from granphon.base.validation import real_number

if TYPE_CHECKING:
    from ase import Atoms


Kind = int
#: kind of balls on the sites of a lattice, in the paper's limit
LATTICE = 0
#: kind of balls on the sites of a lattice, with finite overlap
FINITE = 1
#: kind of balls of a simulated sample
SAMPLE = 2
#: name of the array of scales, which identifies the state that balls belong to
_SCALES = "granphon_scales"
#: name of the array of kinds
_KIND = "granphon_kind"
#: names of the arrays on which energy and force constants depend, with the shape of one ball's
#: entry in a plane
ARRAYS: dict[str, tuple[int, ...]] = {
    _SCALES: (3,),
    _KIND: (),
    "diameter_deviations": (),
    "displacements": (3,),
    "slip_origin": (3,),
    "rotations": (),
}
#: largest component of a lattice vector, in diameters, across the line or the plane of the lattice
_TILT = 1e-3
#: largest error of a logarithm that a file with eight decimals causes
_DECIMALS = 2e-8
#: arrays of Atoms that stand in a file as other columns
_NO_COLUMNS = ("numbers", "positions")
#: names of columns that stand in every file, or that readers take for one of these
_COLUMN_NAMES = ("symbols", "species", "pos", "Z")
#: keys that every second line of a file has
_HEADER_KEYS = ("Lattice", "Properties", "pbc")
#: keys whose entries readers take for matrices of 3 x 3
_MATRIX_KEYS = ("stress", "virial")
#: signs that part names, quote or enclose in the second line of a file, and blanks
_SIGNS = re.compile(r"[\s:\"'\[\]{}\\]")
_MEND = (
    "HertzMindlin(state).adopt(atoms) gives them what is missing;"
    " adopt(atoms, like=other) takes it from the Atoms that they were before a file lost it"
)


def count_coordinates(packing: Packing) -> int:
    """Return the number of coordinates of a ball that count: 1 on a line, 2 in a plane, 3 in space.

    The number is the dimension of the lattice, or more if balls of the ``packing`` move out of it.
    """
    return max(packing.structure.dimension, 1 + max(packing.ball_motions.translations))


def _shapes(coordinates: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of the entry of one ball in each array of :data:`ARRAYS`, by the name of the
    array; ``coordinates`` is from :func:`count_coordinates`.
    """
    if coordinates == 3:  # balls that move in space turn about three axes
        return ARRAYS | {"rotations": (3,)}
    return ARRAYS


def has_masses(balls: Atoms) -> bool:
    """Return whether every ball has a mass that differs from the one in ASE's table for the element
    of its symbol.
    """
    return balls.has("masses") and not np.any(_find_massless(balls))


def _find_massless(balls: Atoms) -> Flags:
    """Return whether each ball (N,) has no mass, or that of ASE's table for the element of its
    symbol: ASE and some of its readers give the mass of an element to a ball without a mass.
    """
    from ase.data import atomic_masses

    return np.asarray(balls.get_masses() == atomic_masses[balls.numbers])


def has_sampled(balls: Atoms) -> bool:
    """Return whether any ball belongs to a simulated sample; balls without a kind do not."""
    return bool(np.any(balls.arrays.get(_KIND, LATTICE) == SAMPLE))


def take_arrays(
    balls: Atoms,
    units: Units,
    kind: Kind,
    new_arrays: Mapping[str, Array] | None = None,
    coordinates: int = 2,
) -> None:
    """Set scales and arrays of the Atoms ``balls``; ``coordinates`` is from
    :func:`count_coordinates`.

    Each array is that of ``new_arrays``; if there is none, the one that the Atoms have, of whatever
    shape; if they have none either, that of balls at rest on the sites of a lattice, which are of
    the ``kind`` and in the ``units``. A ball without a mass gets that of ``new_arrays`` or, if
    there is none, (1 + deviation)^3, as for balls of one material; other balls keep their masses.
    Radii, if the Atoms have none, become those of ``new_arrays`` or (1 + deviation)/2; otherwise
    they stay. The scales also go into ``info``.
    """
    shapes = _shapes(coordinates)
    arrays = {name: np.zeros((len(balls), *shape)) for name, shape in shapes.items()}
    arrays |= {
        _SCALES: np.tile(_take_logarithms(units), (len(balls), 1)),
        _KIND: np.full(len(balls), kind),
    }
    arrays |= {name: balls.arrays[name] for name in ARRAYS if name in balls.arrays}
    arrays |= new_arrays or {}
    if has_masses(balls):
        arrays.pop("masses", None)
    else:
        masses = arrays.get("masses", (1.0 + arrays["diameter_deviations"]) ** 3)
        arrays["masses"] = np.where(_find_massless(balls), masses, balls.get_masses())
    if "radius" in balls.arrays:
        arrays.pop("radius", None)
    else:
        arrays.setdefault("radius", 0.5 * (1.0 + arrays["diameter_deviations"]))
    for name, values in arrays.items():
        balls.set_array(name, None)  # drop an old array that may have another shape or type
        balls.set_array(name, values)
    balls.info.update(units.to_info())


def adopt(
    atoms: Atoms, units: Units, kind: Kind, like: Atoms | None = None, coordinates: int = 2
) -> Atoms:
    """Return a copy of ``atoms`` with the arrays and masses that they lack: those of ``like``, or
    else those of balls at rest on the lattice sites. ``units``, ``kind`` and ``coordinates`` are
    those of :func:`take_arrays`.

    Raises :class:`~granphon.base.errors.InputError` if ``like`` is no Atoms or has another number
    of balls, or if the scales in ``info`` are not those of ``units``.
    """
    from ase import Atoms

    balls = atoms.copy()
    _require_info(balls, units)
    arrays = {}
    if like is not None:
        if not isinstance(like, Atoms):
            raise InputError(f"like is {brief(like)}", mend="Give an ase.Atoms, or None")
        if len(like) != len(balls):
            raise InputError(
                f"like has {len(like)} balls, and the Atoms have {len(balls)}",
                "Arrays are copied ball by ball",
            )
        # masses are taken for the balls without one alone
        names = {*ARRAYS, "radius"} - balls.arrays.keys() | {"masses"}
        arrays = {name: like.arrays[name].copy() for name in sorted(names & like.arrays.keys())}
    take_arrays(balls, units, kind, arrays, coordinates)
    return balls


def find_kind(balls: Atoms, units: Units, finite_overlap: bool, coordinates: int = 2) -> Kind:
    """Return the kind of the balls: :data:`LATTICE`, :data:`FINITE` or :data:`SAMPLE`. Without any
    ball it is the kind of a lattice with or without ``finite_overlap``.

    Raises :class:`~granphon.base.errors.InputError` if an array or masses are missing; if an array
    has another shape or is not of numbers; if balls are of several kinds, or of none of the three;
    or if they belong to a state with other ``units``, another ``finite_overlap`` or another number
    of ``coordinates``.
    """
    missing = [name for name in ARRAYS if not balls.has(name)]
    if not has_masses(balls):
        missing.insert(0, "masses")
    if missing:
        raise InputError(
            f"the Atoms have no {', '.join(missing)}",
            "A file or another program has left this out",
            _MEND,
        )
    _require_shapes(balls, coordinates)
    _require_info(balls, units)
    _require_units(balls, units)
    kinds = set(balls.arrays[_KIND].tolist())
    if len(kinds) > 1:
        raise InputError(
            "the Atoms combine balls on different lattices", mend="Use balls of one lattice"
        )
    kind_without_balls = FINITE if finite_overlap else LATTICE
    kind: Kind = kinds.pop() if kinds else kind_without_balls
    if kind not in (LATTICE, FINITE, SAMPLE):
        raise InputError(
            f"the array {_KIND} of the Atoms has the entry {kind:g}",
            f"Kinds of balls are {LATTICE}, {FINITE} and {SAMPLE}",
            "Make new Atoms with gp.atoms(state)",
        )
    if (kind == FINITE) != finite_overlap:
        ours, theirs = ("with", "without") if finite_overlap else ("without", "with")
        raise InputError(
            f"the Atoms were made {theirs} finite overlap, and this is a calculation {ours} it",
            "Their cells differ by the overlap",
            f"Make the state with finite_overlap={not finite_overlap}, or make new Atoms with"
            f" gp.atoms(state)",
        )
    return kind


def require_lying(balls: Atoms, periods: int) -> None:
    """Raise :class:`InputError` unless the cell of the Atoms is one of balls on a lattice with so
    many ``periods``.

    With one period, the first lattice vector of the cell has to lie along x, and the cell to repeat
    along no other vector. With two, the first two have to lie in the plane of x and y, and the cell
    must not repeat along the third. With three, any cell is accepted.
    """
    if periods == 3:
        return
    where, array = ("line", "one row along x")
    if periods == 2:
        where, array = ("plane", "one layer in x and y")
    if np.any(np.abs(np.asarray(balls.cell)[:periods, periods:]) > _TILT):
        raise InputError(f"the cell is tilted out of the {where}", f"The array is {array}")
    if np.any(balls.pbc[periods:]):
        allowed = tuple(axis < periods for axis in range(3))
        raise InputError(
            f"the balls are periodic across the {where}",
            f"The array is {array}",
            f"Set pbc = {allowed}",
        )


def _take_logarithms(units: Units) -> Array:
    """Return the natural logarithms (3,) of d in m, k in N/m and M in kg."""
    return np.log([units.length, units.stiffness, units.mass])


def _require_shapes(balls: Atoms, coordinates: int) -> None:
    """Raise InputError if an array has another shape than :func:`_shapes` says, or is not of real
    numbers; ``coordinates`` is from :func:`count_coordinates`.
    """
    for name, shape in _shapes(coordinates).items():
        if balls.arrays[name].dtype.kind not in "fiu":
            problem = f"the array {name} has entries of the type {balls.arrays[name].dtype}"
            raise InputError(problem, mend="Give real numbers")
        if balls.arrays[name].shape != (len(balls), *shape):
            axes = "x, y and z" if shape else "z only"
            why = f"The balls of this state turn about {axes}" if name == "rotations" else ""
            raise InputError(
                f"the array {name} has the shape {balls.arrays[name].shape}",
                why,
                f"Give {(len(balls), *shape)}",
            )


def _require_units(balls: Atoms, units: Units) -> None:
    """Raise InputError if a ball has scales that differ from these ``units``."""
    scales = balls.arrays[_SCALES]
    is_same = np.all(np.abs(scales - _take_logarithms(units)) < _DECIMALS, axis=1)
    if not np.all(is_same):
        ball = int(np.argmin(is_same))
        d, k, mass = (f"{value:.9g}" for value in np.exp(scales[ball]))
        raise InputError(
            f"ball {ball} of the Atoms is in the units {d} m, {k} N/m and {mass} kg, and the"
            f" state in {units.length:.9g} m, {units.stiffness:.9g} N/m and {units.mass:.9g} kg",
            "It is in units of another state, or was added without any",
            "Use the state it was made from, and add balls from gp.atoms(state)",
        )


def _require_info(balls: Atoms, units: Units) -> None:
    """Raise InputError if ``info`` of the Atoms has a scale that differs from that of the
    ``units``, or is no number.
    """
    for key, value in units.to_info().items():
        scale = balls.info.get(key, value)
        if not np.isclose(real_number(scale), value, rtol=1e-9, atol=0.0):
            raise InputError(
                f"the Atoms have {key} = {brief(scale)}, the state {value}",
                "They are in the reduced units of another state",
                "Use the state they were made from, or gp.atoms of this one",
            )


def write_extxyz(path: str | Path, atoms: Atoms) -> None:
    """Write Atoms to a file in extended XYZ with every digit; ``ase.io.read`` and OVITO read the
    file.

    ASE's own writer keeps eight decimals. For balls of 8 mm that is 0.1 nm in positions,
    displacements and diameters, and forces depend on differences of these. Masses stand in the
    file twice, as ``masses`` for ASE and as ``mass`` for OVITO. Constraints and results of the
    calculator are not written. The folder is made if need be. A file of granphon is replaced; where
    the Atoms have no arrays of granphon, so is a file of as many balls.

    Some entries mean other things to the reader of ASE: arrays and entries of ``info`` with the
    names of results, as "forces" and "energy", become those of a calculator, and an array
    "move_mask" becomes constraints. Texts of ``info`` that spell a number or a truth value become
    that, and None becomes true.

    Raises :class:`InputError` if ``atoms`` is not an Atoms or ``path`` is not a path, or if what
    the Atoms hold would not be read back:

    - an array with more than two axes or without columns; with other entries than real numbers,
      truth values or texts; with unsigned whole numbers, or one of more than 32 bits, which ASE
      does not read; or with a text that is empty or has blanks;
    - an array whose name is no text, is empty, has blanks, colons, quotes, brackets or backslashes,
      or is "symbols", "species", "pos" or "Z";
    - an entry of ``info`` whose key is no text, is empty, has an equals sign or one of these signs
      other than a blank, or is "Lattice", "Properties" or "pbc";
    - an entry of ``info`` that is an empty array, or a text that is empty or has a line break or a
      backslash; that ASE does not write, such as a complex number, bytes or a set; or of the name
      "stress" or "virial", unless it is an array of nine real numbers.

    Raises :class:`~granphon.base.errors.OutputError` if the file cannot be written, or another
    kind of file is there.
    """
    with needing("A structure file"):
        from ase import Atoms
        from ase.io.extxyz import output_column_format

    require_path(path)
    if not isinstance(atoms, Atoms):
        raise InputError(f"atoms is {brief(atoms)}", mend="Give an ase.Atoms")
    # the columns that every reader expects come first
    arrays: dict[str, Any] = {
        "symbols": np.array(list(atoms.symbols)),
        "positions": atoms.positions,
    }
    arrays |= {name: array for name, array in atoms.arrays.items() if name not in _NO_COLUMNS}
    if "masses" in arrays:
        arrays["mass"] = arrays["masses"]
    for name, array in arrays.items():
        _require_columns(name, array)
    for name in atoms.arrays:
        _require_name(name)
    _require_entries(atoms.info)
    header, _, _, row = output_column_format(atoms, list(arrays), arrays)
    row = row.replace("%16.8f", "%.17g")
    columns = [column for array in arrays.values() for column in np.atleast_2d(array.T)]
    numbers_of_balls = zip(*(column.tolist() for column in columns), strict=True)
    rows = "".join(row % numbers for numbers in numbers_of_balls)
    write_text(path, f"{len(atoms)}\n{header}\n{rows}")


def _require_columns(name: str, array: NDArray[Any]) -> None:
    """Raise :class:`InputError` if ``array`` (N, ...) cannot stand in columns of a file, as
    :func:`write_extxyz` says. The message states the ``name``.
    """
    problem = ""
    if array.ndim > 2 or array.shape[1:] == (0,):
        problem = f"has the shape {array.shape}"
    elif array.dtype.kind not in "fibU":
        problem = f"has entries of the type {array.dtype}"
    elif array.dtype.kind == "i":
        limits = np.iinfo(np.int32)
        is_long = (array < limits.min) | (array > limits.max)
        problem = f"has the whole number {array[is_long][0]}" if np.any(is_long) else ""
    elif array.dtype.kind == "U":
        texts = [str(text) for text in array.ravel()]
        unfit = [text for text in texts if len(text.split()) != 1]
        problem = f"has the text {unfit[0]!r}" if unfit else ""
    if problem:
        raise InputError(
            f"the array {name} of the Atoms {problem}",
            "A row of the file has one ball, and blanks part its columns",
            "Give an array (N,) or (N, n) of real numbers, signed whole numbers of at most 32 bits,"
            " truth values or words, or remove the array",
        )


def _require_name(name: Any) -> None:
    """Raise :class:`InputError` if the ``name`` of an array cannot stand in the second line of a
    file, as :func:`write_extxyz` says.
    """
    is_text = isinstance(name, str) and bool(name)
    if not is_text or _SIGNS.search(name) or name in _COLUMN_NAMES:
        raise InputError(
            f"the Atoms have an array of the name {name!r}",
            "The second line of the file names its columns, and readers would not find this name",
            "Give the array another name, of letters, figures and underscores",
        )


def _require_entries(info: Mapping[Any, Any]) -> None:
    """Raise :class:`InputError` if an entry of ``info`` cannot stand in the second line of a file,
    as :func:`write_extxyz` says.
    """
    for key, value in info.items():
        is_key = isinstance(key, str) and bool(key) and key not in _HEADER_KEYS
        if not is_key or _SIGNS.search(key.replace(" ", "")) or "=" in key:
            problem = f"info of the Atoms has the key {key!r}"
        elif isinstance(value, str) and (not value or re.search(r"[\r\n\\]", value)):
            problem = f"the entry {key} of info of the Atoms is the text {value!r}"
        elif key in _MATRIX_KEYS and not _is_matrix(value):
            problem = f"the entry {key} of info of the Atoms is {brief(value)}, no array of 3 x 3"
        elif not _is_written(value):
            problem = f"the entry {key} of info of the Atoms is {brief(value)}"
        else:
            continue
        raise InputError(
            problem,
            "It would not be read back from the second line of the file",
            "Change it, or remove it from info",
        )


def _is_matrix(value: Any) -> bool:
    """Return whether a ``value`` is an array of nine real numbers, as ASE reads a stress."""
    return isinstance(value, np.ndarray) and value.size == 9 and value.dtype.kind in "fi"


def _is_written(value: Any) -> bool:
    """Return whether ASE writes a ``value`` of an entry of ``info``: of an empty array it writes
    nothing, and what it cannot write it leaves out with a warning.
    """
    from ase.io.extxyz import key_val_dict_to_str

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        entry = key_val_dict_to_str({"key": value})
    return entry not in ("", "key=")
