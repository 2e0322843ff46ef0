"""Band structures and densities of states: the results, their files, and the paths through the Brillouin zone."""

from __future__ import annotations

import itertools
import json
import operator
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import BALL
from granphon.base.arguments import real_array, texts
from granphon.base.digests import own_file, read_sealed, sealed, warn_unverified
from granphon.base.errors import InputError, brief, message
from granphon.base.reading import plain_yaml
from granphon.base.results import Result
from granphon.base.scales import HertzPrefix, Units, file_header, read_header
from granphon.base.staging import write_text
from granphon.dynamics.branches import connect_branches
from granphon.dynamics.modes import Modes

__all__ = ["Bands", "DensityOfStates", "PhononModes", "band_path"]

Array = NDArray[np.float64]
#: the greatest number of points or cells
_MOST = 1_000_000_000


@dataclass(frozen=True, eq=False, repr=False)
class PhononModes(Modes):
    """:class:`~granphon.dynamics.modes.Modes` in SI units, eigenvectors as they are."""

    units = {"wavevectors": "rad/m", "frequencies": "Hz", "group_velocities": "m/s"}

    @classmethod
    def of(cls, modes: Modes, scales: Units) -> PhononModes:
        """The modes in the units of ``scales``."""
        return cls(
            modes.wavevectors / scales.length, modes.frequencies * scales.frequency, modes.eigenvectors,
            modes.group_velocities * scales.velocity, modes.rotational_fraction, modes.longitudinal_fraction,
        )  # fmt: skip


def whole_number(name: str, value: Any, least: int = 1) -> int:
    """``value`` as an int; :class:`~granphon.base.errors.InputError` if it is no whole number, or below ``least``."""
    try:
        number = int(operator.index(value))
    except TypeError:
        number = least - 1
    if not least <= number <= _MOST or isinstance(value, bool | np.bool_):
        raise InputError(message(f"{name} is {brief(value)}", mend=f"Give a whole number from {least} to {_MOST}"))
    return number


def grid_numbers(name: str, values: Any) -> tuple[int, int]:
    """Two whole numbers, or three of which the last is 1; :class:`~granphon.base.errors.InputError` if they are not."""
    try:
        numbers = [whole_number(name, value) for value in values]
    except (TypeError, InputError):
        numbers = []
    if len(numbers) not in (2, 3) or numbers[2:] not in ([], [1]):
        raise InputError(message(f"{name} is {brief(values)}", mend="Give two whole numbers above zero, and 1 as the third"))
    return numbers[0], numbers[1]


def band_path(
    path: str | ArrayLike | Sequence[ArrayLike],
    npoints: int,
    special_points: Mapping[str, ArrayLike],
    labels: Sequence[str] | None = None,
) -> tuple[Array, tuple[str, ...]]:
    """Points along a path through the Brillouin zone, and the labels of its corners.

    Parameters
    ----------
    path : letters of special points ("GKMG", a comma where the path jumps), or corners (n, 2 or 3) in fractions of the
        reciprocal cell, or a list of such arrays.
    npoints : points in each segment, both ends counted; at least 2.
    special_points : what the letters mean.
    labels : one for each corner; by default the letters, or the coordinates.

    Returns
    -------
    qpoints : (n_segments, npoints, 3).
    labels : (n_segments + 1), with "K|M" where the path jumps from K to M.
    """
    count = whole_number("npoints", npoints, 2)
    pieces: list[Array] = []
    names: list[list[str]] = []
    if isinstance(path, str):
        from ase.dft.kpoints import parse_path_string

        for letters in parse_path_string(path):
            unknown = [letter for letter in letters if letter not in special_points]
            if unknown:
                raise InputError(
                    message(
                        f"there is no special point {', '.join(unknown)} in this Brillouin zone",
                        mend="Use " + ", ".join(special_points) + ", or give the path in numbers",
                    )
                )
            pieces.append(np.array([special_points[letter] for letter in letters], float))
            names.append(list(letters))
        if labels is not None:
            names = _split_labels(labels, pieces)
    else:
        given: Any = path
        try:
            try:
                corners = [real_array("path", given)]
            except InputError:  # paths of different lengths, perhaps
                corners = [real_array("path", piece) for piece in given]
        except TypeError:
            raise InputError(message(f"a path is letters or numbers, not {brief(given)}")) from None
        if corners and corners[0].ndim == 3:
            corners = list(corners[0])
        if not corners:
            raise InputError(message(f"the path is {brief(given)}", "It has no corners", "Give letters or numbers"))
        for piece in corners:
            if piece.ndim != 2 or piece.shape[1] not in (2, 3) or not np.all(np.isfinite(piece)):
                raise InputError(message("a path is a list of corners of two or three finite numbers"))
            pieces.append(np.pad(piece, ((0, 0), (0, 3 - piece.shape[1]))))
        names = _split_labels([_name(q) for piece in pieces for q in piece] if labels is None else labels, pieces)
    segments: list[Array] = []
    ticks: list[str] = []
    for piece, name in zip(pieces, names, strict=True):
        if len(piece) < 2:
            raise InputError(message("a path needs at least two corners"))
        if np.any(piece[:, 2] != 0.0):
            raise InputError(message("the path leaves the plane", "The array is one layer", "Set the third number to 0"))
        if np.any(np.all(np.diff(piece, axis=0) == 0.0, axis=1)):
            raise InputError(message("two corners that follow each other on the path are the same point"))
        for start, stop in itertools.pairwise(piece):
            segments.append(start + (stop - start) * np.linspace(0.0, 1.0, count)[:, None])
            segments[-1][-1] = stop
        if ticks:
            ticks[-1] = ticks[-1] if ticks[-1] == name[0] else f"{ticks[-1]}|{name[0]}"
            ticks += name[1:]
        else:
            ticks = list(name)
    return np.array(segments), tuple(ticks)


def _split_labels(labels: Sequence[str], pieces: Sequence[Array]) -> list[list[str]]:
    flat = list(labels if isinstance(labels, str) else texts("labels", labels))  # letters of one text are labels, too
    count = sum(map(len, pieces))
    if len(flat) != count:
        raise InputError(message(f"{len(flat)} labels for {count} corners of the path"))
    ends = np.cumsum([len(piece) for piece in pieces]).tolist()
    return [flat[end - len(piece) : end] for end, piece in zip(ends, pieces, strict=True)]


def _name(q: Array) -> str:
    return "(" + " ".join(f"{x:.3g}" for x in q[:2]) + ")"


@dataclass(frozen=True, eq=False, repr=False)
class Bands(Result):
    """A band structure. Arrays run over segments, points in a segment (ends repeated, as in phonopy) and branches.

    Attributes
    ----------
    qpoints : (s, p, 3), fractions of the reciprocal cell.
    distances : (s, p), along the path, in units of 1/d, without 2 pi, as in phonopy: numbers without a unit.
    frequencies : (s, p, b), Hz, ascending.
    group_velocities : (s, p, b, 2), m/s; at Gamma, and where branches touch, the limit along the path.
    eigenvectors : (s, p, n_dof, b), complex, mass-weighted, orthonormal; dofs (x, y, w) or (x, y) of each ball.
    labels : (s + 1), of the corners.
    cell, positions, masses : (3, 3), (n, 3) fractions, (n,), reduced: the cell the q points belong to.
    scales : the scales of reduced units.
    warnings : limits of the model that the state exceeds.
    """

    units = {"distances": "1", "frequencies": "Hz", "group_velocities": "m/s"}
    shapes = {
        "qpoints": "s p 3", "distances": "s p", "frequencies": "s p b", "group_velocities": "s p b 2",
        "eigenvectors": "s p m b", "labels": "s+1", "cell": "3 3", "positions": "n 3", "masses": "n",
    }  # fmt: skip

    qpoints: Array
    distances: Array
    frequencies: Array
    group_velocities: Array
    eigenvectors: NDArray[np.complex128]
    labels: tuple[str, ...]
    cell: Array
    positions: Array
    masses: Array
    scales: Units
    warnings: tuple[str, ...] = ()

    def check(self) -> None:
        """Also that there are two or three components of each ball, and that all numbers are finite."""
        super().check()
        balls = len(self.masses)
        if self.eigenvectors.shape[2] not in (2 * balls, 3 * balls):
            what = f"{self.eigenvectors.shape[2]} components of an eigenvector for {balls} balls"
            raise InputError(message(what, mend="There are two or three for each"))
        _check_finite(self)

    @property
    def n_branches(self) -> int:
        """3 for each ball with friction, 2 without."""
        return int(self.frequencies.shape[2])

    @cached_property
    def _motion(self) -> NDArray[Any]:
        """(s, p, n_balls, dofs of a ball, b)."""
        s, p, dofs, b = self.eigenvectors.shape
        return self.eigenvectors.reshape(s, p, len(self.masses), dofs // len(self.masses), b)

    @property
    def rotational_fraction(self) -> Array:
        """(s, p, b): the part of the kinetic energy that is rotation, 0 to 1."""
        if self._motion.shape[3] == 2:
            return np.zeros_like(self.frequencies)
        return np.asarray(np.sum(np.abs(self._motion[:, :, :, 2]) ** 2, axis=2))

    @property
    def longitudinal_fraction(self) -> Array:
        """(s, p, b): the part of the kinetic energy that moves along q (along the path, at Gamma)."""
        q = self.qpoints[..., :2] @ np.linalg.inv(self.cell[:2, :2]).T
        ahead = np.broadcast_to((q[:, -1] - q[:, 0])[:, None], q.shape)
        ahead = np.where(np.any(q != 0.0, axis=-1, keepdims=True), q, ahead)
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        along = np.einsum("spiab,spa->spib", self._motion[:, :, :, :2], ahead)
        return np.asarray(np.sum(np.abs(along) ** 2, axis=2))

    @cached_property
    def connection(self) -> NDArray[np.intp]:
        """(s, p, b): ``np.take_along_axis(frequencies, connection, 2)`` follows branches through their crossings.

        Connected by the overlap of eigenvectors inside each segment; numbered by their order at its start.
        """
        return np.array([connect_branches(segment) for segment in self.eigenvectors])

    @property
    def connected_frequencies(self) -> Array:
        """(s, p, b): frequencies with each branch followed through its crossings, Hz."""
        return np.take_along_axis(self.frequencies, self.connection, 2)

    # -- phonopy's band.yaml ----------------------------------------------------------------------------------------

    def write(self, path: str | os.PathLike[str], pad: bool = False) -> None:
        """Write phonopy's band.yaml, with eigenvectors and group velocities, for phonopy-bandplot and Euphonic.

        Frequencies are in the decimal unit of hertz in which the top one lies between 1 and 1000; the file names it. Without
        friction there are two branches for each ball, and w is zero. Programs that want three for each get them with
        ``pad``: below the others the rotation of each ball alone, which nothing resists, at zero frequency. :meth:`read`
        leaves it out.
        """
        top = float(self.frequencies.max())
        unit = HertzPrefix.for_top(top)
        s, p, b = self.frequencies.shape
        n = len(self.masses)
        still = n if pad and self._motion.shape[3] == 2 else 0
        frequencies = np.pad(self.frequencies, ((0, 0), (0, 0), (still, 0)))
        velocities = np.pad(self.group_velocities, ((0, 0), (0, 0), (still, 0), (0, 1)))
        motion = np.zeros((s, p, n, 3, still + b), complex)
        motion[:, :, :, : self._motion.shape[3], still:] = self._motion
        motion[:, :, :, 2, :still] = np.eye(n, still)
        lines = [
            *file_header(unit, self.scales),
            *([f"  still_branches: {still}"] if still else []),
            f"  warnings: {json.dumps(self.warnings)}",
            f"frequency_unit: {unit.name}", "calculator: granphon",
            f"nqpoint: {s * p}", f"npath: {s}", "segment_nqpoint:", *[f"- {p}"] * s,
        ]  # fmt: skip
        ticks = [tick.split("|") for tick in self.labels]
        lines += ["labels:", *(f"- [ {_text(a[-1])}, {_text(z[0])} ]" for a, z in itertools.pairwise(ticks))]
        reciprocal = np.linalg.inv(self.cell).T
        lines += [
            "reciprocal_lattice:",
            *map(_row, reciprocal),
            f"natom: {n}",
            "lattice:",
            *map(_row, self.cell),
            "points:",
        ]
        for place, mass in zip(self.positions, self.masses, strict=True):
            lines += [f"- symbol: {BALL}", f"  coordinates: [ {_numbers(place)} ]", f"  mass: {float(mass)!r}"]
        lines.append("phonon:")
        velocity = self.scales.length * unit.hertz
        for i in range(s):
            for j in range(p):
                lines += [
                    f"- q-position: [ {_numbers(self.qpoints[i, j])} ]",
                    f"  distance: {float(self.distances[i, j])!r}",
                ]
                if j in (0, p - 1):
                    lines.append(f"  label: {_text(ticks[i][-1] if j == 0 else ticks[i + 1][0])}")
                lines.append("  band:")
                for k in range(still + b):
                    lines += [f"  - # {k + 1}", f"    frequency: {float(frequencies[i, j, k] / unit.hertz)!r}"]
                    g = velocities[i, j, k] / velocity
                    lines += [f"    group_velocity: [ {_numbers(g)} ]", "    eigenvector:"]
                    for ball in motion[i, j, :, :, k]:
                        lines += ["    -", *(f"      - [ {_numbers((z.real, z.imag))} ]" for z in ball)]
        write_text(path, sealed(lines))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Bands:
        """Read a band.yaml that granphon wrote.

        :class:`~granphon.base.errors.InputError` if it is another's, damaged or edited,
        :class:`~granphon.base.errors.MissingFileError` if there is none;
        :class:`~granphon.base.errors.UnverifiedFileWarning` if it carries no digest, as another program's copy of it.
        """
        text, verified = read_sealed(path)
        with own_file(path, "band.yaml"):
            data = plain_yaml(text, path)
            own, phonon = data["granphon"], data["phonon"]
            hertz, scales = read_header(own)
            s = int(data["npath"])
            p = len(phonon) // s
            masses = np.array([point["mass"] for point in data["points"]], float)
            n = len(masses)
            still = int(own.get("still_branches", 0))
            bands = [q["band"][still:] for q in phonon]
            b = len(bands[0])
            vectors = np.array([[mode["eigenvector"] for mode in q] for q in bands], float)
            vectors = (vectors[..., 0] + 1j * vectors[..., 1]).reshape(s, p, b, n, 3)[..., : 2 if b == 2 * n else 3]
            pairs = [[str(x) for x in pair] for pair in data["labels"]]
            labels = [pairs[0][0]]
            for pair, following in zip(pairs, [*pairs[1:], None], strict=True):
                jump = following is not None and following[0] != pair[1]
                labels.append(f"{pair[1]}|{following[0]}" if jump and following else pair[1])
            velocities = np.array([[mode["group_velocity"][:2] for mode in q] for q in bands], float)
            found = cls(
                np.array([q["q-position"] for q in phonon], float).reshape(s, p, 3),
                np.array([q["distance"] for q in phonon], float).reshape(s, p),
                np.array([[mode["frequency"] for mode in q] for q in bands], float).reshape(s, p, b) * hertz,
                velocities.reshape(s, p, b, 2) * scales.length * hertz,
                np.moveaxis(vectors.reshape(s, p, b, -1), 2, 3),
                tuple(labels), np.array(data["lattice"], float),
                np.array([point["coordinates"] for point in data["points"]], float), masses, scales, tuple(own["warnings"]),
            )  # fmt: skip
            found.check()
        if not verified:
            warn_unverified(path)
        return found


def _check_finite(result: Result) -> None:
    for name in result.shapes:
        value = getattr(result, name)
        if isinstance(value, np.ndarray) and not np.all(np.isfinite(value)):
            raise InputError(message(f"{name} of the {type(result).__name__} holds what is no finite number"))


def _numbers(values: Any) -> str:
    return ", ".join(repr(float(x)) for x in values)


def _text(words: str) -> str:
    # a JSON string is a YAML string, whatever is in it
    return json.dumps(words)


def _row(values: Any) -> str:
    return f"- [ {_numbers(values)} ]"


_DOS_COLUMNS = "frequency_Hz,total_per_Hz,translational_per_Hz,rotational_per_Hz"
_DOS_SCHEMA = "# granphon density of states, schema {}, per ball"


@dataclass(frozen=True, eq=False, repr=False)
class DensityOfStates(Result):
    """Density of states per ball and hertz; it integrates to the number of branches of a ball.

    With the tetrahedron method each value is the mean over the interval around its frequency, and the trapezoidal sum is
    that number exactly. Of a smeared density the tails below zero are reflected.

    Attributes
    ----------
    frequencies : (n,), Hz.
    translational, rotational : (n,), 1/Hz, the parts of the density weighted with the modes' kinetic energy.
    method : "tetrahedron" or "smearing".
    mesh : (n1, n2).
    warnings : limits of the model that the state exceeds.
    """

    units = {"frequencies": "Hz", "total": "1/Hz", "translational": "1/Hz", "rotational": "1/Hz"}
    shapes = {"frequencies": "n", "translational": "n", "rotational": "n"}

    frequencies: Array
    translational: Array
    rotational: Array
    method: str
    mesh: tuple[int, int]
    warnings: tuple[str, ...] = ()

    def check(self) -> None:
        """Also that all numbers are finite."""
        super().check()
        _check_finite(self)

    @property
    def total(self) -> Array:
        """(n,), 1/Hz."""
        return self.translational + self.rotational

    def write_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the columns frequency, total, translational, rotational with all digits, their units in the heading.

        The heading is the first line, so that spreadsheets and ``numpy.genfromtxt(path, delimiter=",", names=True)`` take
        the names from it; below it are comments with the digest of the file, the method, the mesh and the warnings.
        """
        columns = (self.frequencies, self.total, self.translational, self.rotational)
        lines = [
            _DOS_COLUMNS,
            _DOS_SCHEMA.format(2),
            f"# method {self.method}, mesh {self.mesh[0]} {self.mesh[1]}",
            *(f"# warning: {warning}" for warning in self.warnings),
            *(",".join(repr(float(x)) for x in row) for row in zip(*columns, strict=True)),
        ]
        write_text(path, sealed(lines, 1))

    @classmethod
    def read_csv(cls, path: str | os.PathLike[str]) -> DensityOfStates:
        """Read what :meth:`write_csv` wrote; errors and warning as :meth:`Bands.read`."""
        text, verified = read_sealed(path)
        with own_file(path, "density of states"):
            head, comments, rows = "", [], []
            for line in text.split("\n"):
                if line.startswith("#"):
                    comments.append(line)
                elif not head:
                    head = line
                elif line:
                    rows.append([float(x) for x in line.split(",")])
            what, how = comments[:2]
            words = re.fullmatch(r"# method (\w+), mesh (\d+) (\d+)", how)
            # of schema 1, the heading stood below the comments
            if head != _DOS_COLUMNS or what not in (_DOS_SCHEMA.format(1), _DOS_SCHEMA.format(2)) or words is None:
                raise InputError("its head is not that of one")
            warnings = [line.removeprefix("# warning: ") for line in comments[2:] if line.startswith("# warning: ")]
            if len(warnings) != len(comments) - 2:
                raise InputError("it has a comment that granphon does not write")
            table = np.array(rows)
            mesh = int(words[2]), int(words[3])
            found = cls(table[:, 0], table[:, 2], table[:, 3], words[1], mesh, tuple(warnings))
            found.check()
            if table.shape[1] != 4 or not np.array_equal(found.total, table[:, 1]):
                raise InputError("the total is not the sum of its parts")
        if not verified:
            warn_unverified(path)
        return found
