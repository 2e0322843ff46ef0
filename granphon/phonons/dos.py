"""Densities of states, in memory and in dos.csv."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.results import Result, held, result_class
from granphon.base.staging import write_text
from granphon.base.standard_errors import read_errors
from granphon.base.tables import Table, table_text
from granphon.base.text import read_sealed, require_own_file, require_schema, seal, warn_unverified
from granphon.base.validation import one_of

#: methods by which a density of states is found
METHODS = ("tetrahedron", "smearing")
#: columns of dos.csv, before those of standard errors
_DOS_COLUMNS = ("frequency_Hz", "total_per_Hz", "translational_per_Hz", "rotational_per_Hz")
#: names of the densities
_DENSITIES = ("total", "translational", "rotational")
#: part of the largest density by which a density may be below zero
_ROUNDING = 1e-9
#: version number of dos.csv
_DOS_SCHEMA = 1
#: first comment of dos.csv, with the version number
_DOS_HEAD = "granphon density of states, schema {}, per ball"
#: problem that an error tells if a file holds something else
_NO_DENSITY = "Its heading or its first comments are not those of a density of states"


@result_class
class DensityOfStates(Result):
    """Density of states per ball, 1/Hz; it integrates to the number of motions of a ball.

    With the tetrahedron method each value is the mean over the interval around its frequency, and
    the trapezoidal sum is exactly the number of motions. With smearing, the tails below zero
    frequency are reflected. Branches that cost no energy at any wave vector count too: they are in
    the first interval, or with smearing in the half of a line at zero.

    Attributes
    ----------
    frequencies : (n,), Hz.
    translational, rotational : (n,), 1/Hz, the density with each mode weighted by the translational
        or the rotational fraction of its kinetic energy.
    method : "tetrahedron" or "smearing".
    mesh : (p,), numbers of wave vectors along the axes of the reciprocal cell, one for each period
        of the lattice.
    warnings : one sentence for each limit of the model that the state exceeds, and for branches
        that cost no energy.
    """

    units = {"total": "1/Hz"}

    frequencies: Array = held(float, "n", "Hz")
    translational: Array = held(float, "n", "1/Hz")
    rotational: Array = held(float, "n", "1/Hz")
    method: str = held(str)
    mesh: tuple[int, ...] = held((int, ...))
    warnings: tuple[str, ...] = held((str, ...), default=())

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless shapes fit together, numbers are
        finite, frequencies are zero or above and ascend, no density is below zero by more than
        rounding, the method is one of :data:`METHODS`, and the mesh has points.
        """
        super()._check()
        self._require_finite()
        densities = np.stack([self.translational, self.rotational])
        lowest = -_ROUNDING * densities.max(initial=0.0)
        for holds, fault in (
            (self.frequencies.size > 0, "there is no frequency"),
            (np.all(self.frequencies >= 0.0), "a frequency is below zero"),
            (np.all(np.diff(self.frequencies) > 0.0), "the frequencies do not ascend"),
            (np.all(densities >= lowest), "a density is below zero"),
            (self.method in METHODS, f"the method is {self.method!r}"),
            (min(self.mesh, default=0) > 0, "the mesh has no point"),
        ):
            if not holds:
                raise InputError(fault, mend="Compute the density of states again")

    @property
    def total(self) -> Array:
        """Total density of states, translational plus rotational, (n,), 1/Hz."""
        return self.translational + self.rotational

    def write_csv(
        self, path: str | os.PathLike[str], errors: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Write the columns frequency, total, translational and rotational to the file ``path``,
        with all digits, and with the units in the heading. ``errors`` are standard errors (n,),
        1/Hz, by the names of the densities, "total", "translational" and "rotational", for further
        columns, as total_error_per_Hz, nan where an error is not known. A table that this method
        wrote is replaced.

        Raises :class:`~granphon.base.errors.InputError` for errors of another name or length or
        below zero, for what is no mapping or no path;
        :class:`~granphon.base.errors.FileExistsInRunError` if another file is there; and
        :class:`~granphon.base.errors.OutputError` if the file system refuses the file.

        The heading is the first line, so that spreadsheets and ``numpy.genfromtxt(path,
        delimiter=",", names=True)`` take the names from it. Comments below it hold the digest of
        the file, the method, the mesh and the warnings.
        """
        columns = [self.frequencies, self.total, self.translational, self.rotational]
        names = [*_DOS_COLUMNS]
        named_errors = {} if errors is None else errors
        if not isinstance(named_errors, Mapping):
            raise InputError(
                f"errors is {brief(errors)}", mend=f"Give a mapping of {', '.join(_DENSITIES)}"
            )
        for name, errors_of_density in named_errors.items():
            density = one_of("the name of errors", name, _DENSITIES)
            names.append(f"{density}_error_per_Hz")
            columns.append(read_errors("errors", errors_of_density, self.frequencies.shape))
        numbers = " ".join(str(number) for number in self.mesh)
        comments = (
            _DOS_HEAD.format(_DOS_SCHEMA),
            f"method {self.method}, mesh {numbers}",
            *(f"warning: {warning}" for warning in self.warnings),
        )
        text = table_text(names, np.stack(columns, axis=1).tolist(), comments)
        lines = text.removesuffix("\n").split("\n")
        write_text(path, seal(lines, 1))  # the digest comes after the heading

    @classmethod
    def read_csv(cls, path: str | os.PathLike[str]) -> DensityOfStates:
        """Return the density of states of the file ``path``, which :meth:`write_csv` wrote; columns
        of standard errors are passed over.

        Raises :class:`~granphon.base.errors.InputError` if the file is no density of states of
        granphon, if its digest is not that of its text, or if its numbers do not fit together;
        :class:`~granphon.base.errors.SchemaError`, an InputError too, for another schema; and
        :class:`~granphon.base.errors.MissingFileError` if there is no such file. Warns with
        :class:`~granphon.base.errors.UnverifiedFileWarning` if the file has no digest: a change is
        then noticed only where numbers no longer fit together.
        """
        text, is_verified = read_sealed(path)
        with require_own_file(path, "density of states"):
            table = Table.parse(str(path), text.encode())
            columns = tuple(heading.name for heading in table.headings)
            of_errors = columns[len(_DOS_COLUMNS) :]
            are_errors = all(name.endswith("_error_per_Hz") for name in of_errors)
            if columns[: len(_DOS_COLUMNS)] != _DOS_COLUMNS or not are_errors:
                raise InputError(_NO_DENSITY)
            method, mesh, warnings = _read_comments(path, text)
            frequencies, total, translational, rotational = map(table.numbers, _DOS_COLUMNS)
            density = cls(frequencies, translational, rotational, method, mesh, warnings)
            density._check()
            if not np.array_equal(density.total, total):
                raise InputError("The total is not the sum of its parts")
        if not is_verified:
            warn_unverified(path)
        return density


def _read_comments(
    path: str | os.PathLike[str], text: str
) -> tuple[str, tuple[int, ...], tuple[str, ...]]:
    """Return the method, the mesh (p,) and the warnings of a density of states from the comments in
    the ``text`` of the file ``path``.

    Raises :class:`~granphon.base.errors.InputError` for comments that granphon does not write.
    """
    comments = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("#")]
    if len(comments) < 2:
        raise InputError(_NO_DENSITY)
    head, origin, *notes = comments
    schema = re.fullmatch(_DOS_HEAD.format(r"(\d+)"), head)
    words = re.fullmatch(r"method (\w+), mesh (\d+(?: \d+){0,2})", origin)
    if schema is None or words is None:
        raise InputError(_NO_DENSITY)
    require_schema(path, int(schema[1]), _DOS_SCHEMA)
    if not all(note.startswith("warning: ") for note in notes):
        raise InputError("It has a comment that granphon does not write")
    warnings = tuple(note.removeprefix("warning: ") for note in notes)
    mesh = tuple(int(number) for number in words[2].split())
    return words[1], mesh, warnings
