"""The Brillouin zone of a lattice: its special points, its faces, and paths through the zone, with
their corners and the labels of these.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused, brief, needing
from granphon.base.memory import require_memory
from granphon.base.quantities import NUMBER
from granphon.base.text import closest, counted, show
from granphon.base.validation import fraction, real_array, require, texts, whole_number
from granphon.dynamics.compatibility import require_digits
from granphon.dynamics.zone_means import shortest_vectors

#: memory of a wave vector of a path, bytes
_POINT_BYTES = 100.0
#: the pieces of a path, which do not join; each is a tuple of points of three numbers
Pieces = tuple[tuple[tuple[float, float, float], ...], ...]
#: greatest number of points or cells that an argument may ask for; a larger number is a mistake
LARGEST_COUNT = 1_000_000_000
#: points on each segment of a path of bands, both ends counted, if no number is given
BAND_POINTS = 101
#: mesh of a density of states for one, two and three periods, if none is given
MESHES = ((1024,), (64, 64), (32, 32, 32))
#: mesh on which the edges of bands are sought, for one, two and three periods
_GAP_MESHES = ((256,), (48, 48), (16, 16, 16))
#: number of balls of a cell up to which the whole of such a mesh is used
_MOST_BALLS_OF_MESH = 16
#: greatest coordinate of a path in a scene, with either sign: larger ones are mistakes
_LARGEST_FRACTION = 1e3
#: letters of the corners of the path around the irreducible zone, and the coordinates of the
#: corners as fractions of the reciprocal cell, for a hexagonal cell of 120 degrees and for a square
#: cell
_HEXAGONAL_PATH = "GKMG", "0 0 0 1/3 1/3 0 1/2 0 0 0 0 0"
_SQUARE_PATH = "GXMG", "0 0 0 1/2 0 0 1/2 1/2 0 0 0 0"
#: letters of the path of a face-centred cubic cell; other cells in space have ASE's
_FACE_CENTRED_PATH = "GXWKGL"
#: difference of the products of cell vectors from those of a hexagonal or square cell, over the
#: square of its side, up to which the cell is hexagonal or square
_CELL_TOLERANCE = 1e-6
#: corners of the zone that are closer than this part of its size are one corner
_CORNER_DISTANCE = 1e-6
#: words for the balls of a lattice with one, two or three periods
_SHAPES = ("row", "layer", "crystal")
#: words for the coordinates of a corner, for one, two and three periods
_COUNTS = ("one or three finite numbers", "two or three finite numbers", "three finite numbers")
#: example of a path, for one, two and three periods
_EXAMPLES = ("0 0 0 1/2 0 0", "0 0 0 1/3 1/3 0 1/2 0 0", "0 0 0 1/2 0 1/2 1/2 1/4 3/4")


# -- special points --------------------------------------------------------------------------------


def choose_gap_mesh(balls: int, periods: int) -> tuple[int, ...]:
    """Return the numbers of wave vectors (p,) of the mesh on which the edges of bands are sought,
    for a cell with a number of ``balls`` and p = ``periods``.
    """
    # the zone of a large cell is small, so fewer points do: along each axis by the p-th root
    coarsening = (balls / 4.0) ** (1.0 / periods) if balls > _MOST_BALLS_OF_MESH else 1.0
    return tuple(max(2, round(number / coarsening)) for number in _GAP_MESHES[periods - 1])


def special_points(vectors: ArrayLike, pbc: Sequence[bool] = ()) -> dict[str, Array]:
    """Return the special points of the Brillouin zone of lattice vectors (p, d), by ASE's letters.

    Each point is (3,), in fractions of the reciprocal cell. ``pbc`` (p,) says along which vectors
    balls repeat, by default all; a cluster, which repeats along none, has the points of the cell
    around it. A ribbon that is cut out of a plane has the two points G and X of a line.
    """
    points = _find_band_path(vectors, pbc).special_points
    rows = np.asarray(vectors, float)
    axes = np.flatnonzero(_list_repeats(rows, pbc))
    # on a line ASE may place X on the negative side of G
    is_reversed = len(axes) == 1 and np.min(list(points.values())) < 0.0
    sign = -1.0 if is_reversed else 1.0
    special = {name: sign * np.array(point) + 0.0 for name, point in points.items()}
    is_oblique = len(axes) == 2 and "H1" in special
    if is_oblique:
        # ASE's corners of oblique cells are right for only one of two mirror images
        _move_corners(special, axes, rows[axes])
    return special


def _move_corners(special: dict[str, Array], axes: NDArray[np.intp], periods: Array) -> None:
    """Move the corners H and H1 of the zone of an oblique cell, among its ``special`` points, to
    where they are at equal distances from 0, 2C and 2Y, and from 0, 2C and 2X.

    ``periods`` (2, d) are the vectors along which balls repeat, and ``axes`` (2,) the numbers of
    their components among the three of a point.
    """
    # scalar products of reciprocal vectors
    reciprocal_gram = np.linalg.inv(periods @ periods.T)
    for corner, side in (("H", "Y"), ("H1", "X")):
        neighbours = 2.0 * np.array([special[side], special["C"]])[:, axes]
        products = neighbours @ reciprocal_gram
        halves = 0.5 * np.sum(products * neighbours, axis=1)
        special[corner][axes] = np.linalg.solve(products, halves)


def _list_repeats(vectors: Array, pbc: Sequence[bool]) -> list[bool]:
    """Return whether balls repeat along each of the ``vectors`` (p, d), as ``pbc`` of
    :func:`special_points` says; along all if ``pbc`` names none, as a cluster, which repeats
    nowhere, has the zone of the cell around it.
    """
    return list(pbc) if any(pbc) else [True] * len(vectors)


def default_letters(vectors: ArrayLike, pbc: Sequence[bool] = ()) -> str:
    """Return the letters of the path from corner to corner of the irreducible zone, for a cell with
    lattice vectors (p, d).

    The letters are GX on a line, GKMG and GXMG for hexagonal and square cells of the plane, and
    GXWKGL for face-centred cubic cells. For other cells the letters are those of ASE, in which a
    comma marks a jump. ``pbc`` is that of :func:`special_points`.
    """
    path = _find_band_path(vectors, pbc)
    if len(path.special_points) < 4:  # hexagonal and square cells of the plane have three points
        for letters, _ in (_HEXAGONAL_PATH, _SQUARE_PATH):
            if set(letters) <= set(path.special_points):
                return letters
    if path.path.startswith(_FACE_CENTRED_PATH):
        return _FACE_CENTRED_PATH
    return str(path.path)


def _find_band_path(vectors: ArrayLike, pbc: Sequence[bool]) -> Any:
    """Return ASE's band path, an object with the special points and the standard path, of a cell
    with lattice vectors (p, d) and ``pbc`` of :func:`special_points`.
    """
    with needing("A path through the zone"):
        from ase.cell import Cell

    periods = np.asarray(vectors)
    cell = np.eye(3)
    p = len(periods)
    cell[:p, :p] = periods[:, :p]
    repeats = _list_repeats(periods, pbc)
    return Cell(cell).bandpath(npoints=0, pbc=(*repeats, *(False,) * (3 - p)))


def split_letters(path: str) -> list[list[str]]:
    """Return the letters of special points in each piece of a ``path``: [["G", "X1"], ["L", "G"]]
    for "GX1,LG". Text that is not the letter of a point becomes an item of its own.
    """
    pieces = []
    for piece in path.split(","):
        names = re.split("([A-Z][a-z0-9]*)", piece)
        pieces.append([name for name in names if name])
    return pieces


# -- points along a path ---------------------------------------------------------------------------


def interpolate_path(
    path: str | ArrayLike | Sequence[ArrayLike],
    npoints: int,
    special_points: Mapping[str, ArrayLike],
    labels: Sequence[str] | None = None,
    periods: int = 2,
) -> tuple[Array, tuple[str, ...]]:
    """Return the points along a path through the Brillouin zone, and the labels of its corners.

    Parameters
    ----------
    path : letters of special points ("GKMG", a comma where the path jumps), or corners (n, p) or
        (n, 3) in fractions of the reciprocal cell, or a list of such arrays.
    npoints : points in each segment, both ends counted; at least 2.
    special_points : the point that each letter means, in fractions of the reciprocal cell.
    labels : one for each corner; by default the letters, or the coordinates. In a single text each
        character is a label.
    periods : number p of periods of the lattice.

    Returns
    -------
    qpoints : (n_segments, npoints, 3), in fractions of the reciprocal cell.
    labels : (n_segments + 1), with "K|M" where the path jumps from K to M.

    Raises
    ------
    InputError : an unknown letter; a path that is not letters or finite numbers, has fewer than two
        corners, leaves the lattice or has the same corner twice in a row; ``npoints`` that is no
        whole number from 2 on, or does not fit into memory; another number of labels than corners,
        or labels that are no texts.
    PrecisionError : a corner of more than 1e15 reciprocal vectors.
    """
    count = whole_number("npoints", npoints, 2, LARGEST_COUNT)
    if isinstance(path, str):
        pieces, names = _read_letters(path, special_points)
    else:
        pieces = _read_corners(path, periods)
        names = [_name_corner(corner[:periods]) for piece in pieces for corner in piece]
    if labels is not None:
        words = texts("labels", labels)
        is_one_text = isinstance(labels, str) or getattr(labels, "ndim", 1) == 0
        # in a single text each character is a label
        names = list(words[0] if is_one_text else words)
    corner_count = sum(map(len, pieces))
    if len(names) != corner_count:
        raise InputError(
            f"{counted(len(names), 'label')} for {counted(corner_count, 'corner')} of the path",
            mend="Give one for each corner",
        )
    points = sum(len(piece) - 1 for piece in pieces) * count
    require_memory(f"paths of {points:,} wave vectors", _POINT_BYTES * points, "Give fewer npoints")
    steps = np.linspace(0.0, 1.0, count)[:, None]
    segments: list[Array] = []
    for piece in pieces:
        _check_piece(piece, periods)
        for start, stop in itertools.pairwise(piece):
            segment = start + (stop - start) * steps
            segment[-1] = stop  # exactly, without the rounding of the difference
            segments.append(segment)
    return np.array(segments), _join_names(pieces, names)


def _read_letters(
    path: str, special_points: Mapping[str, ArrayLike]
) -> tuple[list[Array], list[str]]:
    """Return the corners (n, 3) of each piece of a path of letters, and the letters of all corners.

    ``special_points`` are the points (3,) by their letters. Raises
    :class:`~granphon.base.errors.InputError` for a letter of no special point.
    """
    pieces = []
    names = []
    for letters in split_letters(path):
        unknown = [letter for letter in letters if letter not in special_points]
        if unknown:
            raise InputError(
                f"there is no special point {', '.join(unknown)} in this Brillouin zone",
                mend=f"Use {', '.join(special_points)}, or give the path in numbers",
            )
        pieces.append(np.array([special_points[letter] for letter in letters], float))
        names += letters
    return pieces, names


def _read_corners(path: Any, periods: int) -> list[Array]:
    """Return the corners (n, 3) of each piece of a ``path`` of numbers: an array (n, ``periods``)
    or (n, 3), or a list of such arrays.

    Raises :class:`~granphon.base.errors.InputError` for anything else, and for numbers that are not
    finite.
    """
    try:
        try:
            pieces = [real_array("path", path)]
        except InputError:  # perhaps a list of arrays of different lengths
            pieces = [real_array("path", piece) for piece in path]
    except TypeError:
        raise InputError(
            f"a path is letters or numbers, not {brief(path)}",
            mend="Give letters such as 'GKMG', or corners in fractions of the reciprocal cell",
        ) from None
    if pieces and pieces[0].ndim == 3:
        pieces = list(pieces[0])
    if not pieces:
        raise InputError(
            f"the path is {brief(path)}", "It has no corners", "Give letters or numbers"
        )
    pieces_in_space = []
    for piece in pieces:
        are_corners = piece.ndim == 2 and piece.shape[1] in (periods, 3)
        if not are_corners or not np.all(np.isfinite(piece)):
            raise InputError(f"a path is a list of corners of {_COUNTS[periods - 1]}")
        pieces_in_space.append(np.pad(piece, ((0, 0), (0, 3 - piece.shape[1]))))
    return pieces_in_space


def _name_corner(corner: Array) -> str:
    """Return a label made of the coordinates of a ``corner`` (p,)."""
    return "(" + " ".join([f"{x:.3g}" for x in corner]) + ")"


def _check_piece(piece: Array, periods: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if a ``piece`` (n, 3) of a path has fewer
    than two corners, a component that is not zero beyond the first ``periods`` components (a wave
    vector has one for each period of the lattice), or the same corner twice in a row.
    """
    if len(piece) < 2:
        raise InputError("a path needs at least two corners", mend="Name another point")
    check_inside(piece, periods, "the path")
    is_repeated = np.all(np.diff(piece, axis=0) == 0.0, axis=1)
    if np.any(is_repeated):
        raise InputError(
            "two corners that follow each other on the path are the same point",
            mend="Leave one out",
        )


def _join_names(pieces: list[Array], names: list[str]) -> tuple[str, ...]:
    """Return the labels of the corners of a path, "K|M" where a piece ends at K and the next begins
    at M.

    ``names`` are those of the corners of all ``pieces`` (n, 3), one after the other.
    """
    labels: list[str] = []
    first = 0
    for piece in pieces:
        start, *following = names[first : first + len(piece)]
        first += len(piece)
        if not labels:
            labels.append(start)
        elif labels[-1] != start:
            labels[-1] = f"{labels[-1]}|{start}"
        labels += following
    return tuple(labels)


def check_inside(qpoints: Array, periods: int, what: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if wave vectors ``qpoints`` (n, 3), called
    ``what`` in the message, have a component across the ``periods`` of the lattice, and
    :class:`~granphon.base.errors.PrecisionError` if they are too far from Gamma.
    """
    require_digits(qpoints)
    if np.any(qpoints[:, periods:] != 0.0):
        shape = "line"
        mend = "Set the second and the third number to 0"
        if periods == 2:
            shape = "plane"
            mend = "Set the third number to 0"
        raise InputError(
            f"{what} leaves the {shape}", f"The array is one {_SHAPES[periods - 1]}", mend
        )


# -- paths of a scene ------------------------------------------------------------------------------


def read_paths(value: Any, periods: int = 2, letters: str = "") -> Pieces:
    """Return the pieces of the path that is written in a text, ``value``, such as
    "0 0 0 1/3 1/3 0, 1/2 0 0 0 0 0"; a comma separates pieces that do not join.

    A point has three numbers, of which those beyond the ``periods`` of the lattice are 0. Messages
    name ``letters``, a path of special points, as what may be written instead. Raises
    :class:`~granphon.base.errors.Refused` for other values.
    """
    example = _EXAMPLES[periods - 1]
    allowed = (
        f"points of three numbers or fractions each, such as '{example}'; a comma stands between"
        f" pieces that do not join"
    )
    if letters:
        allowed = f"letters of special points, such as {letters}, or {allowed}"
    if not isinstance(value, str):
        raise Refused(show(value), allowed, "Write the points as one line of text.")
    paths = []
    for piece in value.split(","):
        numbers = [_read_fraction(word, value, allowed) for word in piece.split()]
        are_points = len(numbers) % 3 == 0 and len(numbers) >= 6
        if not are_points:
            raise Refused(
                f"{show(value)}, with {counted(len(numbers), 'number')} in a path",
                allowed,
                "A path has two points or more.",
            )
        points = tuple(zip(numbers[0::3], numbers[1::3], numbers[2::3], strict=True))
        _refuse_across(points, periods, value, allowed)
        if _has_repeats(points):
            raise Refused(f"{show(value)}, with the same point twice in a row", allowed)
        paths.append(points)
    return tuple(paths)


def _has_repeats(points: Sequence[Any]) -> bool:
    """Return whether two successive ``points`` are equal."""
    return any(point == following for point, following in itertools.pairwise(points))


def _refuse_across(
    points: tuple[tuple[float, float, float], ...], periods: int, value: str, allowed: str
) -> None:
    """Raise :class:`~granphon.base.errors.Refused` if one of the ``points`` has a component across
    the ``periods`` of the lattice.

    The message quotes the text ``value`` from which the points were read, and says what is
    ``allowed``.
    """
    for point in points:
        for axis in range(periods, 3):
            if point[axis] != 0.0:
                ordinal = ("second", "third")[axis - 1]
                shape = _SHAPES[periods - 1]
                raise Refused(
                    f"{show(value)}, with a {ordinal} number that is not 0",
                    allowed,
                    f"The packing is one {shape}.",
                )


def _read_fraction(word: str, value: str, allowed: str) -> float:
    """Return the number that a ``word`` of the text ``value`` is, such as "1/3".

    Raises :class:`~granphon.base.errors.Refused`, which says what is ``allowed``, for a word that
    is not a number or a fraction, or too large.
    """
    try:
        return fraction(word, _LARGEST_FRACTION)
    except Refused as refused:
        fault = f"{show(word)} in {show(value)}"
        is_too_large = re.fullmatch(NUMBER, word) is not None
        if is_too_large:
            raise Refused(fault, refused.allowed) from None
        raise Refused(fault, allowed) from None


def read_point(value: Any, structure: Lattice) -> Array:
    """Return a wave vector (3,) of the lattice ``structure``, in fractions of the reciprocal cell.

    ``value`` is the letter of a special point, such as "K", or a text of numbers or fractions,
    separated by spaces or commas. Gamma is "G", "Gamma", "GAMMA" or "Γ". The numbers are as many as
    periods, or three, and those beyond the periods are zero. Raises
    :class:`~granphon.base.errors.Refused` for another value, and for a number that is too large.
    """
    letters = special_points(structure.vectors)
    p = structure.periods
    count, example = {
        1: ("one number or fraction", "1/2"),
        2: ("two numbers or fractions", "1/3 1/3"),
        3: ("three numbers or fractions", "1/2 1/4 3/4"),
    }[p]
    allowed = f"{', '.join(letters)}, or {count}, such as '{example}'"
    if not isinstance(value, str):
        raise Refused(show(value), allowed)
    name = "G" if value in ("Gamma", "GAMMA", "Γ") else value
    if name in letters:
        return letters[name]
    is_word = re.fullmatch(r"\s*[^\W\d_]\w*\s*", value) is not None
    if is_word:
        letter = closest(value.strip(), letters)
        raise Refused(show(value), allowed, f"Did you mean {letter!r}?" if letter else "")
    numbers = [_read_fraction(word, value, allowed) for word in value.replace(",", " ").split()]
    if len(numbers) not in (p, 3):
        raise Refused(f"{show(value)}, with {counted(len(numbers), 'number')}", allowed)
    if any(numbers[p:]):
        shape = ("line", "plane")[p - 1]
        raise Refused(f"{show(value)}, which leaves the {shape}", allowed)
    point = np.zeros(3)
    point[:p] = numbers[:p]
    return point


def read_labels(value: Any) -> tuple[str, ...]:
    """Return the labels of the corners from a ``value``, a text such as "G K M G" or a list of
    words.

    Raises :class:`~granphon.base.errors.Refused` for words that are no labels.
    """
    words = value.split() if isinstance(value, str) else value
    are_listed = isinstance(words, list | tuple) and bool(words)
    if not are_listed or not all(_is_label(word) for word in words):
        raise Refused(
            show(value),
            "a short label for each point of the band, such as G K M G, without quotes,"
            " spaces or |",
        )
    return tuple(words)


def _is_label(word: Any) -> bool:
    """Return whether a ``word`` is a text of 1 to 40 printable characters, without quotes, spaces
    or "|".
    """
    if not isinstance(word, str):
        return False
    return re.fullmatch(r"[^\s'\"|]{1,40}", word) is not None and word.isprintable()


@dataclass(frozen=True)
class BandPath:
    """The path of a band structure: one or more pieces of two points or more, with a label for
    every point or without labels.

    Attributes
    ----------
    paths : the pieces, which do not join. A piece is a tuple of n q points, (n, 3) fractions of the
        reciprocal cell.
    labels : the names of the points of all pieces, one after the other; None without labels.

    Raises
    ------
    InputError : there is no piece, a piece is not two or more points of three finite numbers, or
        the labels are no texts, or not one for each point.
    """

    paths: Pieces
    labels: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check the pieces and the labels, and hold them as tuples of floats and of texts."""
        paths: Any = self.paths
        if not isinstance(paths, list | tuple) or not paths:
            raise InputError(
                f"the path of the band is {brief(paths)}",
                mend="Give one piece or more, each of two points or more",
            )
        pieces = [real_array("band", piece) for piece in paths]
        for piece in pieces:
            are_points = piece.ndim == 2 and len(piece) >= 2 and piece.shape[1] == 3
            if not are_points or not np.all(np.isfinite(piece)):
                raise InputError(
                    f"a piece of the path of the band is {brief(piece.tolist())}",
                    mend="Give two points or more, each of three finite numbers",
                )
        # tuples of floats, because these can be hashed, whatever was given
        paths_of_floats = tuple(tuple(tuple(point) for point in piece.tolist()) for piece in pieces)
        object.__setattr__(self, "paths", paths_of_floats)
        labels: Any = self.labels
        if labels is None:
            return
        are_texts = isinstance(labels, tuple) and set(map(type, labels)) <= {str}
        if not are_texts:
            labels = texts("labels", labels)
            object.__setattr__(self, "labels", labels)
        count = sum(len(piece) for piece in pieces)
        if len(labels) != count:
            raise InputError(
                f"found {counted(len(labels), 'label')}; allowed: {count}, one for each point of"
                " the band."
            )

    @classmethod
    def parse(cls, points: str, labels: str | Sequence[str] | None = None) -> Self:
        """Return a path from phonopy's notation: points such as "0 0 0 1/3 1/3 0", and labels such
        as "G K".

        Raises :class:`~granphon.base.errors.InputError` for another notation.
        """
        names = None
        if labels is not None:
            names = require("band_labels", read_labels, labels)
        paths = require("band", partial(read_paths, periods=3), points)
        return cls(paths, names)

    @classmethod
    def read(cls, value: Any, structure: Lattice) -> Self:
        """Return a path through the zone of the lattice ``structure``, read from the text
        ``value``: letters of special points ("GKMG"), or points as fractions of the reciprocal
        cell.

        Raises :class:`~granphon.base.errors.Refused` for another text; the message shows a path of
        letters and a path of numbers of this lattice.
        """
        has_letters = isinstance(value, str) and re.fullmatch(r"\s*[A-Za-z][A-Za-z0-9,\s]*", value)
        if not has_letters:
            try:
                return cls(read_paths(value, structure.periods))
            except Refused:  # read again, to raise with ASE's letters in the message
                return cls(read_paths(value, structure.periods, default_letters(structure.vectors)))
        special = special_points(structure.vectors)
        letters = default_letters(structure.vectors)
        pieces = split_letters("".join(value.split()))
        names = tuple(itertools.chain.from_iterable(pieces))
        unknown = [name for name in names if name not in special]
        if unknown:
            allowed = f"{', '.join(special)}, such as {letters}, or points in numbers"
            raise Refused(f"{show(value)}, with the letter {unknown[0]}", allowed)
        paths: Any = [[special[name].tolist() for name in piece] for piece in pieces]
        for piece in paths:
            if len(piece) < 2 or _has_repeats(piece):
                allowed = f"two different points or more in a row, such as {letters}"
                raise Refused(show(value), allowed)
        return cls(paths, names)

    @classmethod
    def default(cls, structure: Lattice) -> Self:
        """Return the path around the irreducible zone of the lattice ``structure``, with the
        letters of :func:`default_letters`.
        """
        cell = structure.vectors
        # scalar products of the vectors, over the square of the first
        gram = cell @ cell.T / cell[0].dot(cell[0])
        has_equal_sides = structure.periods == 2 and abs(gram[1, 1] - 1.0) < _CELL_TOLERANCE
        if has_equal_sides:
            # the paths of hexagonal and square cells are known without ASE
            for cosine, (letters, points) in ((-0.5, _HEXAGONAL_PATH), (0.0, _SQUARE_PATH)):
                if abs(gram[0, 1] - cosine) < _CELL_TOLERANCE:
                    return cls.parse(points, tuple(letters))
        return cls.read(default_letters(cell), structure)

    @property
    def names(self) -> tuple[str, ...]:
        """The labels of all points; if there are none, texts of the coordinates of the points."""
        if self.labels:
            return self.labels
        points = itertools.chain.from_iterable(self.paths)
        return tuple(" ".join(f"{x:.4g}" for x in point) for point in points)

    @property
    def arrays(self) -> list[Array]:
        """Each piece of the path as an array (n_points, 3), in fractions of the reciprocal cell."""
        return [np.array(path) for path in self.paths]

    def __str__(self) -> str:
        """Return the path in the notation of :meth:`parse`: the numbers of all points of a piece,
        and a comma between pieces.
        """
        pieces = []
        for path in self.paths:
            numbers = itertools.chain.from_iterable(path)
            pieces.append(" ".join(map(_write_coordinate, numbers)))
        return ", ".join(pieces)


def _write_coordinate(x: float) -> str:
    """Return the text of a number ``x``: a fraction if one with a denominator of at most 100 is
    exactly ``x`` in double precision, else a decimal number with all digits.
    """
    nearest_fraction = Fraction(x).limit_denominator(100)
    return str(nearest_fraction) if float(nearest_fraction) == x else repr(x)


# -- the zone itself: a polygon in the plane, faces in space ---------------------------------------


def zone_polygon(reciprocal: ArrayLike) -> Array:
    """Return the corners (n, 2), anticlockwise, of the Brillouin zone in the plane, in the unit of
    ``reciprocal``: the Wigner-Seitz cell of the lattice of the rows of ``reciprocal`` (2, 2).
    """
    shortest = shortest_vectors(np.asarray(reciprocal, float))
    a, b = shortest
    if a @ b > 0.0:
        b = -b
    # as the angle between a and b is at least 90 degrees, these are the neighbours of the origin in
    # turn. Each corner of the zone is as far from two successive neighbours as from the origin
    neighbours = np.array([a, a + b, b, -a, -a - b, -b])
    pairs = np.stack([neighbours, np.roll(neighbours, -1, axis=0)], axis=1)
    halves = 0.5 * np.sum(pairs**2, axis=2)
    corners = np.linalg.solve(pairs, halves[..., None])[..., 0]
    anticlockwise = np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))
    corners = corners[anticlockwise]
    # for a rectangular lattice two of the six corners coincide with others, and are left out
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    return np.asarray(corners[sides > _CORNER_DISTANCE * np.linalg.norm(shortest)])


def zone_faces(reciprocal: ArrayLike) -> list[Array]:
    """Return the faces of the Brillouin zone in space: those of the Wigner-Seitz cell of the
    lattice of the rows of ``reciprocal`` (3, 3).

    Each face is an array (n, 3) of its corners in turn, anticlockwise as seen from outside, in the
    unit of ``reciprocal``.
    """
    # imported here, as only a zone in space needs SciPy; the function of ASE would load matplotlib
    from scipy.spatial import Voronoi

    shortest = shortest_vectors(np.asarray(reciprocal, float))
    size = float(np.linalg.norm(shortest, axis=1).max())
    steps = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
    points = steps @ shortest / size
    gamma = len(points) // 2  # the middle one of the 27 points
    cells = Voronoi(points)
    faces = []
    for vertices, pair in zip(cells.ridge_vertices, cells.ridge_points, strict=True):
        if gamma not in pair:
            continue
        ring = cells.vertices[vertices]
        sides = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
        corners = ring[sides > _CORNER_DISTANCE]
        # where the zone touches a neighbour along an edge or at a corner, their face has no area
        if len(corners) < 3:
            continue
        spokes = corners[1:] - corners[0]
        area = np.sum(np.cross(spokes[:-1], spokes[1:]), axis=0)
        if not np.linalg.norm(area) > _CORNER_DISTANCE:
            continue
        # from Gamma, the origin, to the neighbour
        outward = points[pair].sum(axis=0)
        is_anticlockwise = area @ outward > 0.0
        if not is_anticlockwise:
            corners = corners[::-1]
        faces.append(np.asarray(corners * size))
    return faces
