"""The Brillouin zone of a lattice: its special points, its faces, and paths through it with their
corners and labels.
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
from numpy.typing import ArrayLike

from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused, brief, needing
from granphon.base.memory import require_memory
from granphon.base.quantities import NUMBER
from granphon.base.text import closest, counted, show
from granphon.base.validation import fraction, real_array, require, texts, whole_number
from granphon.dynamics.compatibility import require_digits
from granphon.dynamics.zone_quadrature import shortest_vectors

#: memory of a wave vector of a path, bytes
_POINT_BYTES = 100.0
#: the pieces of a path, each a tuple of points of three numbers
Pieces = tuple[tuple[tuple[float, float, float], ...], ...]
#: greatest number of points or cells that an argument may ask for; a larger one is a mistake
LARGEST_COUNT = 1_000_000_000
#: mesh of a density of states for one, two and three periods, if none is given
MESHES = ((1024,), (64, 64), (32, 32, 32))
#: greatest size of a coordinate of a path in a scene
_LARGEST_FRACTION = 1e3
#: letters of the corners of the path around the irreducible zone, and their coordinates as
#: fractions of the reciprocal cell, for a hexagonal cell of 120 degrees and for a square one
_HEXAGONAL_PATH = "GKMG", "0 0 0 1/3 1/3 0 1/2 0 0 0 0 0"
_SQUARE_PATH = "GXMG", "0 0 0 1/2 0 0 1/2 1/2 0 0 0 0"
#: letters of the path of a face-centred cubic cell; other cells in space have ASE's
_FACE_CENTRED_PATH = "GXWKGL"
#: difference of a cell from a hexagonal or square one, over the square of its side, that is put
#: down to rounding
_SAME = 1e-6
#: corners of the zone that are closer than this part of its size are one corner
_SAME_CORNER = 1e-6
#: what the balls of a lattice with one, two or three periods make
_SHAPES = ("row", "layer", "crystal")


# -- special points --------------------------------------------------------------------------------


def special_points(vectors: ArrayLike, pbc: Sequence[bool] = ()) -> dict[str, Array]:
    """Find the special points of the Brillouin zone of lattice vectors (p, d), keyed by ASE's
    letters.

    Each point is (3,), in fractions of the reciprocal cell. ``pbc`` says along which vectors balls
    repeat, by default all: a ribbon cut out of a plane has the two points G and X of a line.
    """
    points = _find_band_path(vectors, pbc).special_points
    signs = -1.0 if sum(pbc) == 1 and np.min(list(points.values())) < 0.0 else 1.0
    special = {name: signs * np.array(point) + 0.0 for name, point in points.items()}
    if (sum(pbc) or len(np.asarray(vectors))) == 2 and "H1" in special:
        # ASE has the corners of oblique cells right in one of two mirror images only: a corner is
        # as far from 0 as from 2Y, 2C or 2X
        cell = np.asarray(vectors, float)[:2, :2]
        for corner, side in (("H", "Y"), ("H1", "X")):
            g = 2.0 * np.array([special[side], special["C"]])[:, :2] @ np.linalg.inv(cell).T
            special[corner][:2] = cell @ np.linalg.solve(g, 0.5 * np.sum(g**2, axis=1))
    return special


def default_letters(vectors: ArrayLike, pbc: Sequence[bool] = ()) -> str:
    """Return the letters of the path of a cell (p, d) from corner to corner of its irreducible
    zone.

    They are GX on a line, GKMG and GXMG in hexagonal and square cells of the plane, GXWKGL in
    face-centred cubic ones; of other cells ASE's, where a comma marks a jump. ``pbc`` is as in
    :func:`special_points`.
    """
    path = _find_band_path(vectors, pbc)
    if len(path.special_points) < 4:  # hexagonal and square cells of the plane have three points
        for letters, _ in (_HEXAGONAL_PATH, _SQUARE_PATH):
            if set(letters) <= set(path.special_points):
                return letters
    return _FACE_CENTRED_PATH if path.path.startswith(_FACE_CENTRED_PATH) else str(path.path)


def _find_band_path(vectors: ArrayLike, pbc: Sequence[bool]) -> Any:
    """Return ASE's band path of a cell with lattice vectors (p, d), which knows its special points
    and the standard path.
    """
    with needing("A path through the zone"):
        from ase.cell import Cell

    periods = np.asarray(vectors)
    cell = np.eye(3)
    p = len(periods)
    cell[:p, :p] = periods[:, :p]
    # a cluster, which repeats nowhere, has the zone of the cell that it was put into
    repeats = pbc if any(pbc) else (True,) * p
    return Cell(cell).bandpath(npoints=0, pbc=(*repeats, *(False,) * (3 - p)))


def split_letters(path: str) -> list[list[str]]:
    """Return the letters of special points in each piece of a path: "GX1,LG" is [["G", "X1"], ["L",
    "G"]].
    """
    return [
        [name for name in re.split("([A-Z][a-z0-9]*)", piece) if name] for piece in path.split(",")
    ]


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
    labels : one for each corner; by default the letters, or the coordinates.
    periods : number p of periods of the lattice.

    Returns
    -------
    qpoints : (n_segments, npoints, 3), in fractions of the reciprocal cell.
    labels : (n_segments + 1), with "K|M" where the path jumps from K to M.

    Raises
    ------
    InputError : an unknown letter; a path that is not letters or finite numbers, has fewer than two
        corners, leaves the lattice or has the same corner twice in a row; ``npoints`` below 2;
        another number of labels than corners.
    """
    count = whole_number("npoints", npoints, 2, LARGEST_COUNT)
    pieces: list[Array] = []
    said: list[str] = []  # labels of the corners where none are given
    if isinstance(path, str):
        for letters in split_letters(path):
            unknown = [letter for letter in letters if letter not in special_points]
            if unknown:
                raise InputError(
                    f"there is no special point {', '.join(unknown)} in this Brillouin zone",
                    mend=f"Use {', '.join(special_points)}, or give the path in numbers",
                )
            pieces.append(np.array([special_points[letter] for letter in letters], float))
            said += letters
    else:
        given: Any = path
        try:
            try:
                corners = [real_array("path", given)]
            except InputError:  # the path may be a list of arrays of different lengths
                corners = [real_array("path", piece) for piece in given]
        except TypeError:
            mend = "Give letters such as 'GKMG', or corners in fractions of the reciprocal cell"
            raise InputError(
                f"a path is letters or numbers, not {brief(given)}", mend=mend
            ) from None
        if corners and corners[0].ndim == 3:
            corners = list(corners[0])
        if not corners:
            raise InputError(
                f"the path is {brief(given)}", "It has no corners", "Give letters or numbers"
            )
        for piece in corners:
            if (
                piece.ndim != 2
                or piece.shape[1] not in (periods, 3)
                or not np.all(np.isfinite(piece))
            ):
                many = (
                    "one or three finite numbers",
                    "two or three finite numbers",
                    "three finite numbers",
                )[periods - 1]
                raise InputError(f"a path is a list of corners of {many}")
            pieces.append(np.pad(piece, ((0, 0), (0, 3 - piece.shape[1]))))
            said += ["(" + " ".join(f"{x:.3g}" for x in q[:periods]) + ")" for q in piece]
    if labels is not None:
        # of a string, each letter is a label
        said = list(labels if isinstance(labels, str) else texts("labels", labels))
    corner_count = sum(map(len, pieces))
    if len(said) != corner_count:
        mend = "Give one for each corner"
        raise InputError(
            f"{counted(len(said), 'label')} for {counted(corner_count, 'corner')} of the path",
            mend=mend,
        )
    points = sum(len(piece) - 1 for piece in pieces) * count
    require_memory(f"paths of {points:,} wave vectors", _POINT_BYTES * points, "Give fewer npoints")
    segments: list[Array] = []
    ticks: list[str] = []
    for piece in pieces:
        name = said[: len(piece)]
        said = said[len(piece) :]
        if len(piece) < 2:
            raise InputError("a path needs at least two corners", mend="Name another point")
        check_inside(piece, periods, "the path")
        if np.any(np.all(np.diff(piece, axis=0) == 0.0, axis=1)):
            raise InputError(
                "two corners that follow each other on the path are the same point",
                mend="Leave one out",
            )
        for start, stop in itertools.pairwise(piece):
            segments.append(start + (stop - start) * np.linspace(0.0, 1.0, count)[:, None])
            segments[-1][-1] = stop
        ticks[-1:] = [f"{ticks[-1]}|{name[0]}" if ticks and ticks[-1] != name[0] else name[0]]
        ticks += name[1:]
    return np.array(segments), tuple(ticks)


def check_inside(qpoints: Array, periods: int, what: str) -> None:
    """Raise InputError if wave vectors (n, 3), called ``what``, have a component across the
    ``periods`` of the lattice.
    """
    require_digits(qpoints)
    if np.any(qpoints[:, periods:] != 0.0):
        line, mend = (
            ("line", "Set the second and the third number to 0"),
            ("plane", "Set the third number to 0"),
        )[periods - 1]
        raise InputError(
            f"{what} leaves the {line}", f"The array is one {_SHAPES[periods - 1]}", mend
        )


# -- paths of a scene ------------------------------------------------------------------------------


def read_paths(value: Any, periods: int = 2, letters: str = "") -> Pieces:
    """Read paths of points from text such as "0 0 0 1/3 1/3 0, 1/2 0 0 0 0 0"; a comma separates
    paths that do not join.

    A point has three numbers, of which those beyond the ``periods`` of the lattice are 0.
    ``letters`` is a path of special points that may stand in their place, for messages.
    """
    example = ("0 0 0 1/2 0 0", "0 0 0 1/3 1/3 0 1/2 0 0", "0 0 0 1/2 0 1/2 1/2 1/4 3/4")[
        periods - 1
    ]
    allowed = (
        f"points of three numbers or fractions each, such as '{example}'; a comma parts separate"
        f" paths"
    )
    if letters:
        allowed = f"letters of special points, such as {letters}, or {allowed}"
    if not isinstance(value, str):
        raise Refused(show(value), allowed, "Write the points as one line of text.")
    paths = []
    for piece in value.split(","):
        numbers = [_fraction(word, value, allowed) for word in piece.split()]
        if len(numbers) % 3 or len(numbers) < 6:
            raise Refused(
                f"{show(value)}, with {len(numbers)} numbers in a path",
                allowed,
                "A path has two points or more.",
            )
        points = tuple(
            (numbers[n], numbers[n + 1], numbers[n + 2]) for n in range(0, len(numbers), 3)
        )
        across = [axis for point in points for axis in range(periods, 3) if point[axis] != 0.0]
        if across:
            ordinal = ("second", "third")[across[0] - 1]
            shape = ("row", "layer")[periods - 1]
            raise Refused(
                f"{show(value)}, with a {ordinal} number that is not 0",
                allowed,
                f"The packing is one {shape}.",
            )
        if any(point == following for point, following in itertools.pairwise(points)):
            raise Refused(f"{show(value)}, with the same point twice in a row", allowed)
        paths.append(points)
    return tuple(paths)


def _fraction(word: str, value: str, allowed: str) -> float:
    try:
        return fraction(word, _LARGEST_FRACTION)
    except Refused as refused:
        raise Refused(
            f"{show(word)} in {show(value)}",
            refused.allowed if re.fullmatch(NUMBER, word) else allowed,
        ) from None


def read_point(value: Any, structure: Lattice) -> Array:
    """Read a wave vector (3,) of a lattice, in fractions of the reciprocal cell.

    ``value`` is the letter of a special point, such as "K" (Gamma is G), or a text of numbers or
    fractions, one for each period or three, parted by spaces or commas.
    :class:`~granphon.base.errors.Refused` if it is neither.
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
    if re.fullmatch(r"\s*[^\W\d_]\w*\s*", value):
        meant = closest(value.strip(), letters)
        raise Refused(show(value), allowed, f"Did you mean {meant!r}?" if meant else "")
    numbers = [_fraction(word, value, allowed) for word in value.replace(",", " ").split()]
    if len(numbers) not in (p, 3):
        raise Refused(f"{show(value)}, with {len(numbers)} numbers", allowed)
    if any(numbers[p:]):
        raise Refused(f"{show(value)}, which leaves the {('line', 'plane')[p - 1]}", allowed)
    return np.array([*numbers[:p], *[0.0] * (3 - p)])


def read_labels(value: Any) -> tuple[str, ...]:
    """Read the labels of the corners from text such as "G K M G" or from a list of words."""
    words = value.split() if isinstance(value, str) else value
    listed = isinstance(words, list | tuple) and bool(words)
    if not listed or not all(
        isinstance(w, str) and re.fullmatch(r"[^\s'\"|]{1,40}", w) and w.isprintable()
        for w in words
    ):
        raise Refused(
            show(value),
            "a short label for each point of the band, such as G K M G, without quotes,"
            " spaces or |",
        )
    return tuple(words)


@dataclass(frozen=True)
class BandPath:
    """The path of a band structure: one or more pieces of two points or more, with a label for
    every point or for none.

    Attributes
    ----------
    paths : the pieces, which do not join. A piece is a tuple of n q points, (n, 3) fractions of the
        reciprocal cell.
    labels : the name of each point; None for none.

    Raises
    ------
    InputError : there is no piece, a piece is not two or more points of three finite numbers, or
        there are labels, but not one for each point.
    """

    paths: Pieces
    labels: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
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
        plain = tuple(tuple(map(tuple, piece.tolist())) for piece in pieces)
        object.__setattr__(self, "paths", plain)
        count = sum(map(len, self.paths))
        if self.labels is not None and len(self.labels) != count:
            raise InputError(
                f"found {len(self.labels)} labels; allowed: {count}, one for each point of"
                f" the band."
            )

    @classmethod
    def parse(cls, points: str, labels: str | Sequence[str] | None = None) -> Self:
        """Read a path in phonopy's notation: points such as "0 0 0 1/3 1/3 0", and labels such as
        "G K".
        """
        named = None if labels is None else require("band_labels", read_labels, labels)
        return cls(require("band", partial(read_paths, periods=3), points), named)

    @classmethod
    def read(cls, value: Any, structure: Lattice) -> Self:
        """Read a path through the zone of a lattice.

        ``value`` has special points by their letters ("GKMG"), or points as fractions of the
        reciprocal cell.

        Raises :class:`~granphon.base.errors.Refused`, with a path of letters and one of numbers
        that the lattice has.
        """
        if not (isinstance(value, str) and re.fullmatch(r"\s*[A-Za-z][A-Za-z0-9,\s]*", value)):
            try:
                return cls(read_paths(value, structure.periods))
            except Refused:  # ASE, which knows the letters, is asked for a message only
                return cls(read_paths(value, structure.periods, default_letters(structure.vectors)))
        special = special_points(structure.vectors)
        letters = default_letters(structure.vectors)
        names = [tuple(piece) for piece in split_letters("".join(value.split()))]
        unknown = [name for piece in names for name in piece if name not in special]
        if unknown:
            allowed = f"{', '.join(special)}, such as {letters}, or points in numbers"
            raise Refused(f"{show(value)}, with the letter {unknown[0]}", allowed)
        paths: Any = [[special[name].tolist() for name in piece] for piece in names]
        for piece in paths:
            repeats = any(point == following for point, following in itertools.pairwise(piece))
            if repeats or len(piece) < 2:
                allowed = f"two different points or more in a row, such as {letters}"
                raise Refused(show(value), allowed)
        return cls(paths, tuple(name for piece in names for name in piece))

    @classmethod
    def default(cls, structure: Lattice) -> Self:
        """Return the path around the irreducible zone of a lattice.

        It is that of :func:`default_letters`.
        """
        cell = structure.vectors
        gram = cell @ cell.T / cell[0].dot(cell[0])
        if structure.periods == 2 and abs(gram[1, 1] - 1.0) < _SAME:
            # the paths of hexagonal and square cells are known without ASE
            for cosine, (letters, points) in ((-0.5, _HEXAGONAL_PATH), (0.0, _SQUARE_PATH)):
                if abs(gram[0, 1] - cosine) < _SAME:
                    return cls.parse(points, tuple(letters))
        return cls.read(default_letters(cell), structure)

    @property
    def names(self) -> tuple[str, ...]:
        """The labels of all points; of a path without labels their numbers."""
        return self.labels or tuple(
            " ".join(f"{x:.4g}" for x in point) for piece in self.paths for point in piece
        )

    @property
    def arrays(self) -> list[Array]:
        """Each piece of the path as an array (n_points, 3), in fractions of the reciprocal cell."""
        return [np.array(path) for path in self.paths]

    def __str__(self) -> str:
        pieces = [[_write_coordinate(x) for point in path for x in point] for path in self.paths]
        return ", ".join(" ".join(words) for words in pieces)


def _write_coordinate(x: float) -> str:
    """Return a number as text: as a fraction, if it is one with a denominator up to 100."""
    near = Fraction(x).limit_denominator(100)
    return str(near) if float(near) == x else repr(x)


# -- the zone itself: a polygon in the plane, faces in space ---------------------------------------


def zone_polygon(reciprocal: ArrayLike) -> Array:
    """Find the corners (n, 2), anticlockwise, of the Brillouin zone: the Wigner-Seitz cell of the
    rows of ``reciprocal``.

    ``reciprocal`` is (2, 2); the corners have its unit.
    """
    a, b = short = shortest_vectors(np.asarray(reciprocal, float))
    b = -b if a @ b > 0.0 else b
    # the angle of a and b is at least 90 degrees, so that g are the neighbours of the origin in
    # turn; each corner of the zone is as far from two successive neighbours as from the origin
    g = np.array([a, a + b, b, -a, -a - b, -b])
    pairs = np.stack([g, np.roll(g, -1, axis=0)], axis=1)
    corners = np.linalg.solve(pairs, 0.5 * np.sum(pairs**2, axis=2)[..., None])[..., 0]
    corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    return np.asarray(corners[sides > _SAME_CORNER * np.linalg.norm(short)])


def zone_faces(reciprocal: ArrayLike) -> list[Array]:
    """Find the faces of the Brillouin zone in space: the Wigner-Seitz cell of the rows of
    ``reciprocal``.

    ``reciprocal`` is (3, 3). Each face is (n, 3), its corners in turn, anticlockwise as seen from
    outside, in the same unit.
    """
    # imported here, as only a zone in space needs it; the function of ASE would load matplotlib
    from scipy.spatial import Voronoi

    short = shortest_vectors(np.asarray(reciprocal, float))
    faces = []
    size = float(np.linalg.norm(short, axis=1).max())
    points = np.array(list(itertools.product((-1, 0, 1), repeat=3))) @ short / size
    cells = Voronoi(points)
    gamma = 13
    for vertices, pair in zip(cells.ridge_vertices, cells.ridge_points, strict=True):
        if gamma not in pair:
            continue
        ring = cells.vertices[vertices]
        outward = points[pair].sum(axis=0)
        # a neighbour that the zone touches in an edge or a corner only gives a face without area
        corners = ring[np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) > _SAME_CORNER]
        if len(corners) < 3:
            continue
        spokes = corners[1:] - corners[0]
        area = np.sum(np.cross(spokes[:-1], spokes[1:]), axis=0)
        if np.linalg.norm(area) > _SAME_CORNER:
            faces.append(np.asarray(corners[:: 1 if area @ outward > 0.0 else -1] * size))
    return faces
