"""The Phonopy object for balls in contact, and its files.

The coordinates of phonopy's atoms hold the motions of balls (:mod:`granphon.phonons.phonopy_atoms`), in the plane
(u_x, u_y, w) with w = R_g phi. A translation of the lattice does not change w, which is an axial quantity. Methods that
symmetrise force constants, or enforce their sum rule, are therefore wrong here: :class:`ContactPhonopy` refuses them, and
exported files are made so that they do no harm.
"""

from __future__ import annotations

import math
import os
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from phonopy import Phonopy
from phonopy.physical_units import get_physical_units
from phonopy.structure.atoms import PhonopyAtoms

from granphon.balls.motions import Motions
from granphon.base.digests import read_sealed, require_own_file, seal, warn_unverified
from granphon.base.errors import InputError, UnsupportedError, message
from granphon.base.scales import HertzPrefix, Units, read_header
from granphon.base.staging import write_text
from granphon.base.text import plain_yaml, versions, write_float
from granphon.phonons.phonopy_atoms import make_header, name_atoms, read_motions

Array = NDArray[np.float64]

_SYMMETRY = "it imposes the sum rule or the space group of translations, and some coordinates are rotations"
_DATASET = "it replaces the force constants by those of displaced supercells, and here they come from the contacts"
_QUANTA = "it takes frequencies for THz and rotations for displacements of atoms"
_VOLUME = "it takes the path and the mesh from the symmetry of a crystal of atoms; use Phonons.bands or Phonons.dos"
_FIXED = "force constants, masses and group velocities belong together; make another Phonons(state, atoms)"
_CHARGE = "balls carry no charge"
_FILE = "phonopy symmetrises what it reads from such a file, and the rotational branch falls to zero; use Phonons.save"
_UNGUARDED = "its copy would lose these guards and the force constants; make another Phonons(state, atoms)"

#: methods that read the result of a refused method, which is the key
_READERS = {
    "run_irreps": ("show_irreps", "write_yaml_irreps"),
    "run_modulations": (
        "get_modulated_supercells", "get_modulations_and_supercell", "write_modulations", "write_yaml_modulations",
    ),
    "run_moment": ("get_moment",),
    "run_dynamic_structure_factor": ("get_dynamic_structure_factor",),
    "run_thermal_properties": (
        "get_thermal_properties_dict", "plot_thermal_properties", "write_yaml_thermal_properties",
    ),
    "run_thermal_displacements": (
        "get_thermal_displacements_dict", "plot_thermal_displacements", "write_yaml_thermal_displacements",
    ),
    "run_thermal_displacement_matrices": (
        "get_thermal_displacement_matrices_dict", "write_thermal_displacement_matrix_to_cif",
        "write_yaml_thermal_displacement_matrices",
    ),
}  # fmt: skip
#: methods of phonopy.Phonopy that would give a wrong answer for balls, each with the reason
REFUSED: dict[str, str] = {
    **dict.fromkeys(
        ("symmetrize_force_constants", "symmetrize_force_constants_by_space_group", "set_irreps", "run_irreps"), _SYMMETRY
    ),
    **dict.fromkeys(
        ("generate_displacements", "produce_force_constants", "develop_mlp", "load_mlp", "save_mlp", "evaluate_mlp"),
        _DATASET,
    ),
    **dict.fromkeys(
        (
            "run_thermal_properties", "run_thermal_displacements", "run_thermal_displacement_matrices",
            "init_random_displacements", "get_random_displacements_at_temperature", "init_dynamic_structure_factor",
            "run_dynamic_structure_factor", "run_modulations", "write_animation", "set_Debye_frequency",
        ),
        _QUANTA,
    ),
    **dict.fromkeys(("auto_band_structure", "auto_total_dos", "auto_projected_dos"), _VOLUME),
    **dict.fromkeys(("save", "to_phonopy_yaml"), _FILE),
    "get_Debye_frequency": "it counts three branches of sound for each atom in space; rotations and a layer have others",
    "run_moment": "it drops modes of negative frequency, so that modes at zero count or not as rounding has it",
    "set_force_constants_zero_with_radius": _FIXED,
    **dict.fromkeys(("copy", "replicate", "ph2ph"), _UNGUARDED),
    **{reader: f"it reads the result of {run}, which is refused" for run, readers in _READERS.items() for reader in readers},
}  # fmt: skip
#: attributes that may be read but not set, each with the reason
READ_ONLY: dict[str, str] = {
    **dict.fromkeys(("dataset", "displacements", "forces", "supercell_energies", "mlp", "mlp_dataset"), _DATASET),
    **dict.fromkeys(("force_constants", "masses"), _FIXED),
    "nac_params": _CHARGE,
}

#: factor by which exported force constants are multiplied, so that the fixed number of decimals that phonopy writes keeps
#: every digit; a power of two, so that no digit changes
_EXPORT_SCALE = 2.0**30
#: symbol, position (fractions of the cell) and mass (in masses of a ball) of an export's auxiliary atom, see Phonons.save
_AUXILIARY = "He"
_AUXILIARY_PLACE = (0.137, 0.291, 0.373)
_AUXILIARY_MASS = 1e32


def _refuse(name: str, reason: str) -> Any:
    def method(self: Any, *args: Any, **kwargs: Any) -> NoReturn:
        raise UnsupportedError(message(f"Phonopy.{name} is refused for balls in contact: {reason}"))

    method.__name__ = name
    method.__doc__ = f"Raises UnsupportedError: {reason}."
    return method


class ContactPhonopy(Phonopy):  # type: ignore[misc]
    """A ``phonopy.Phonopy`` in reduced units, frequencies in (k/M)^1/2, whose methods that are wrong for balls raise.

    What they raise is :class:`~granphon.base.errors.UnsupportedError`.
    """

    def give_force_constants(self, force_constants: Array) -> None:
        """Set the force constants, in units of k, that the calculator found; they are read-only from then on."""
        Phonopy.force_constants.fset(self, force_constants)
        self.force_constants.setflags(write=False)


for _name, _reason in REFUSED.items():
    setattr(ContactPhonopy, _name, _refuse(_name, _reason))
for _name, _reason in READ_ONLY.items():
    _base = getattr(Phonopy, _name)
    setattr(ContactPhonopy, _name, property(_base.fget, _refuse(f"{_name} = ...", _reason), doc=_base.__doc__))


def write_phonopy(
    bridge: ContactPhonopy, path: str | os.PathLike[str], scales: Units, top: float, motions: Motions, periods: int
) -> None:
    """Write the force constants of ``bridge`` so that phonopy reads them correctly without options; see ``Phonons.save``.

    ``top`` is the highest frequency, Hz; ``motions`` are those of each ball.
    """
    unit = HertzPrefix.for_top(top)
    per_frequency = scales.frequency / unit.hertz / get_physical_units().DefaultToTHz
    mass = _EXPORT_SCALE / per_frequency**2
    own = bridge.unitcell
    n = len(own)
    # the auxiliary atom's, and one for each coordinate that holds no motion: what a reader sees at zero besides the branches
    zero_bands = 3 + n // motions.atoms_per_ball * len(motions.still_slots)
    cell = PhonopyAtoms(
        symbols=[*own.symbols, _AUXILIARY], cell=own.cell, masses=np.append(own.masses, _AUXILIARY_MASS) * mass,
        scaled_positions=np.vstack([own.scaled_positions, _AUXILIARY_PLACE]),
    )  # fmt: skip
    export = Phonopy(cell, bridge.supercell_matrix, primitive_matrix="P", is_symmetry=False, log_level=0)
    export.force_constants = _add_auxiliary(bridge.force_constants, export) * _EXPORT_SCALE
    # phonopy writes physical units into the file unless the factor was set, if only to its own value
    export.unit_conversion_factor = export.unit_conversion_factor
    head = [
        *make_header(unit, scales, motions, periods), f"  version: {versions()['granphon']}",
        f"  force_constants_scale: {write_float(_EXPORT_SCALE)}", f"  auxiliary_atom: {_AUXILIARY}",
        f"  zero_bands: {zero_bands}",
        "  masses:", *(f"  - {write_float(m)}" for m in own.masses.tolist()), "",
    ]  # fmt: skip
    body = str(export.to_phonopy_yaml(settings={"force_constants": True}))
    write_text(path, seal([*head, *body.removesuffix("\n").split("\n")]))


def _add_auxiliary(own: Array, export: Phonopy) -> Array:
    """Return compact force constants of the cell and the auxiliary atom, which is coupled to the balls of its own cell."""
    n, cells = own.shape[0], own.shape[1] // own.shape[0]
    total = own.sum(axis=1)  # (n, 3, 3): what the sum rule lacks
    out = np.zeros((n + 1, (n + 1) * cells, 3, 3))
    # phonopy orders a supercell by atom, then by cell
    out[:n, : n * cells] = own
    first = [int(s) for s in export.primitive.p2s_map]
    auxiliary = first[n]
    out[:n, auxiliary] = -total
    for ball in range(n):
        out[n, first[ball]] = -total[ball].T
    back = total.sum(axis=0).T
    out[n, auxiliary] = 0.5 * (back + back.T)
    return out


def load_phonopy(path: str | os.PathLike[str]) -> tuple[ContactPhonopy, Units]:
    """Read a file of :meth:`Phonons.save`: the Phonopy object in reduced units, without the auxiliary atom, and the scales.

    Only the named file is read, as plain data; phonopy's own loader is not used.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : granphon did not write the file, or it was damaged or edited afterwards.

    Warns
    -----
    UnverifiedFileWarning : the file carries no digest.
    """
    text, verified = read_sealed(path)
    with require_own_file(path, "phonopy_params.yaml"):
        data = plain_yaml(text, path)
        own = data["granphon"]
        _, scales = read_header(path, own)
        masses, scale = _read_numbers(own["masses"], (-1,)), float(_read_numbers(own["force_constants_scale"], ()))
        n = len(masses)
        points = data["unit_cell"]["points"]
        symbols, (motions, periods) = [point["symbol"] for point in points], read_motions(own)
        matrix = np.array(data["supercell_matrix"])
        if len(points) != n + 1 or symbols != [*name_atoms(n // motions.atoms_per_ball, motions), _AUXILIARY]:
            raise InputError("Its cell does not consist of balls and the auxiliary atom")
        cells = _count_cells(matrix, periods)
        if masses.min() <= 0.0 or scale <= 0.0:
            raise InputError("Its masses and scales are not above zero")
        constants = _read_force_constants(data["force_constants"], n + 1, cells)
        cell = PhonopyAtoms(
            symbols=symbols[:n], cell=_read_numbers(data["unit_cell"]["lattice"], (3, 3)), masses=masses,
            scaled_positions=_read_numbers([point["coordinates"] for point in points[:n]], (n, 3)),
        )  # fmt: skip
        bridge = ContactPhonopy(cell, matrix, primitive_matrix="P", is_symmetry=False, log_level=0)
        bridge.unit_conversion_factor = 1.0
        bridge.give_force_constants(constants[:n, : len(bridge.supercell)] / scale)
    if not verified:
        warn_unverified(path)
    return bridge, scales


def _count_cells(matrix: NDArray[Any], periods: int) -> int:
    """Return the number of cells of a supercell n1 x n2 x n3, 1 across the periods; raises InputError for another matrix.

    Granphon writes no other matrix, and phonopy may never return from one.
    """
    # Python's integers, whose product does not overflow
    numbers = [int(n) for n in np.diag(matrix)] if matrix.shape == (3, 3) and matrix.dtype.kind == "i" else [0]
    if min(numbers) < 1 or set(numbers[periods:]) - {1} or not np.array_equal(matrix, np.diag(numbers)):
        shown = " x ".join(["n1", "n2", "n3"][:periods] + ["1"] * (3 - periods))
        raise InputError(f"Its supercell_matrix is not that of {shown} cells")
    return math.prod(numbers)


def _read_numbers(values: Any, shape: tuple[int, ...]) -> Array:
    """Read finite numbers of a file as a float array of this shape, in which -1 stands for any length."""
    found = np.array(values)
    if found.dtype.kind not in "if" or found.ndim != len(shape) or not np.all(np.isfinite(found)):
        raise InputError("It has something else where finite numbers are needed")
    if any(wanted not in (-1, length) for wanted, length in zip(shape, found.shape, strict=True)):
        raise InputError(f"It has numbers of shape {found.shape} instead of {shape}")
    return found.astype(float)


def _read_force_constants(block: dict[str, Any], atoms: int, cells: int) -> Array:
    """Read (atoms, atoms * cells, 3, 3) from phonopy's block ``force_constants``, which may have the rows of all cells."""
    rows, columns = block["shape"]
    if columns != atoms * cells or rows not in (atoms, columns):
        raise InputError(f"Its force constants of shape {block['shape']} do not fit {cells} cells of {atoms} atoms")
    found = _read_numbers(block["elements"], (rows * columns, 3, 3)).reshape(rows, columns, 3, 3)
    # phonopy orders a supercell by atom, then by cell
    return found if rows == atoms else found[::cells]
