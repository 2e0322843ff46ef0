"""What a crystal is made of: balls of several kinds, and the sites on which they touch; and the
diameters that may be given of a sample.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.ball import RIGID_PLANE, Ball
from granphon.balls.lattices import Lattice
from granphon.balls.neighbours import TOUCH
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, brief
from granphon.base.text import counted
from granphon.base.validation import finite_array, real_array

#: least length, area or volume of a cell, over the mean radius, its square or its cube
_LEAST_CELL = 1e-3


def list_balls(balls: Any) -> list[Any]:
    """Return ``balls``, the argument of a public call, as a list; one ball is a list of one.

    Raises :class:`~granphon.base.errors.InputError` for an argument without an order, or a text.
    """
    sequence = balls.tolist() if isinstance(balls, np.ndarray) else balls
    if isinstance(sequence, Ball):
        return [sequence]
    has_no_order = isinstance(sequence, str | bytes | Mapping | set | frozenset)
    if has_no_order or not isinstance(sequence, Iterable):
        raise InputError(f"the balls are {brief(balls)}", mend="Give a list of granphon.Ball")
    return list(sequence)


def find_kinds(balls: Sequence[Any]) -> tuple[tuple[Ball, ...], Index]:
    """Return the different balls in the order in which they come, and the number (n,) of the kind
    of each of the n ``balls``.

    Raises :class:`~granphon.base.errors.InputError` if there are no balls, or an entry is no ball.
    """
    if not balls:
        raise InputError("there are no balls", mend="Give a list of granphon.Ball")
    # one ball often stands on many sites: an object is compared with the kinds once
    number_of_object: dict[int, int] = {}
    number_of_ball: dict[Ball, int] = {}
    numbers = []
    for ball in balls:
        number = number_of_object.get(id(ball))
        if number is None:
            if not isinstance(ball, Ball):
                problem = f"{brief(ball)} is not a ball"
                raise InputError(problem, mend="Give a granphon.Ball for each site")
            number = number_of_ball.setdefault(ball, len(number_of_ball))
            number_of_object[id(ball)] = number
        numbers.append(number)
    return tuple(number_of_ball), np.array(numbers, np.intp)


def _count_in_letters() -> Iterator[str]:
    """Yield A, B, ..., Z, AA, AB, ..."""
    for size in itertools.count(1):
        for letters in itertools.product(ascii_uppercase, repeat=size):
            yield "".join(letters)


def name_kinds(
    kinds: Sequence[Ball], known_names: Mapping[Ball, str] | None = None
) -> tuple[str, ...]:
    """Return the name of each kind: the name of its ball in ``known_names``; if there is none, the
    name that the ball itself has; and if there is none, the next unused of A, B, C, ...

    Raises :class:`~granphon.base.errors.InputError` if two kinds have the same name, or a kind is
    called "floor".
    """
    given_names = known_names or {}
    names = {ball: given_names.get(ball) or ball.name for ball in kinds}  # empty if there is none
    used_names = {name for name in names.values() if name} | {RIGID_PLANE.name}
    unused_letters = (letters for letters in _count_in_letters() if letters not in used_names)
    kind_names = tuple(names[ball] or next(unused_letters) for ball in kinds)
    counts = Counter([*kind_names, RIGID_PLANE.name])
    repeated_name = next((name for name in kind_names if counts[name] > 1), None)
    if repeated_name == RIGID_PLANE.name:
        raise InputError(
            f"a kind of balls is called {repeated_name!r}",
            "That is the name of the rigid plane on which crystals stand",
            "Name the kind differently",
        )
    if repeated_name is not None:
        raise InputError(
            f"two kinds are called {repeated_name!r}",
            "Laws are given by names",
            "Name each kind differently",
        )
    return kind_names


def read_sites(positions: ArrayLike, cell: ArrayLike) -> tuple[Array, Array]:
    """Return the centres (n, d) and the vectors (p, d) of a cell, m, with p <= d <= 3; an empty
    ``cell`` has none.

    Raises :class:`~granphon.base.errors.InputError` if their shapes do not fit, there is no centre,
    or an entry is no finite real number.
    """
    centres = real_array("positions", positions)
    vectors = real_array("cell", cell)
    are_centres = centres.ndim == 2 and len(centres) > 0 and 1 <= centres.shape[1] <= 3
    if not are_centres:
        problem = f"positions of the crystal have the shape {centres.shape}"
        raise InputError(problem, mend="Give (n, d) centres in m, d = 1, 2 or 3")
    d = centres.shape[1]
    if vectors.size == 0:  # an empty list
        vectors = vectors.reshape(0, d)
    are_vectors = vectors.ndim == 2 and vectors.shape[1] == d and len(vectors) <= d
    if not are_vectors:
        coordinates = counted(d, "coordinate")
        problem = f"the cell has the shape {vectors.shape}, and positions have {coordinates}"
        mend = f"Give up to {counted(d, 'vector')} of {counted(d, 'number')}, as rows, in m"
        raise InputError(problem, mend=mend)
    if not (np.all(np.isfinite(centres)) and np.all(np.isfinite(vectors))):
        problem = "the cell or a position of the crystal is not finite"
        raise InputError(problem, mend="Give finite numbers, in m")
    return centres, vectors


def read_diameters(diameters: ArrayLike, periods: int, n: int) -> Array:
    """Return the ``diameters`` of a sample with ``periods`` p and ``n`` balls in the cell: an array
    (L1, ..., Lp), or (L1, ..., Lp, n) if n > 1, m.

    Raises :class:`~granphon.base.errors.InputError` for another shape, and for numbers that are
    not finite and above zero.
    """
    array = finite_array("diameters", diameters, "m", "above zero")
    axes = [f"L{axis + 1}" for axis in range(periods)]
    if n > 1:
        axes.append(str(n))
    has_axis_of_balls = n == 1 or array.shape[-1:] == (n,)
    if array.ndim != len(axes) or not has_axis_of_balls:
        problem = f"diameters have the shape {array.shape}"
        raise InputError(problem, mend=f"Give an array ({', '.join(axes)})")
    return array


def require_symbols(symbols: Sequence[str], balls: object) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless there are atoms, and ``balls`` is a
    mapping that has each of their ``symbols``.
    """
    if not symbols:
        raise InputError("there are no atoms", mend="Give one or more")
    if not isinstance(balls, Mapping):
        mend = 'Give balls by symbols, as {"Na": ball}'
        raise InputError(f"the balls are {brief(balls)}", mend=mend)
    missing_symbols = sorted(set(symbols) - set(balls))
    if missing_symbols:
        problem = f"there is no ball for {', '.join(missing_symbols)}"
        raise InputError(problem, mend="Give one for each symbol")


def find_dimension(positions: Array, cell: Array, tolerance: float) -> int:
    """Return the dimension, 1 to 3, of the line, plane or space in which balls lie, from their
    positions (n, 3) and a cell (p, 3), m.

    The coordinate z, and then y, is left out if all balls have the same one to a ``tolerance``, m,
    no period has a component along the axis, and there are fewer periods than axes.
    """
    for dimension in (3, 2):
        axis = dimension - 1
        are_level = np.ptp(positions[:, axis]) <= tolerance
        has_component = np.any(np.abs(cell[:, axis]) > tolerance)
        if len(cell) >= dimension or has_component or not are_level:
            return dimension
    return 1


def require_cell(vectors: Array, radius: float, name: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a cell (p, d), m, that does not lie along
    the first axes, or has no room for a ball of the mean ``radius``, m.
    """
    p = len(vectors)
    if np.any(np.abs(vectors[:, p:]) > TOUCH * radius):
        extent = ("", "along x", "in the xy plane", "")[p]
        problem = f"the cell of crystal {name!r} does not lie {extent}"
        raise InputError(problem, mend="Turn the crystal")
    relative_measure = abs(np.linalg.det(vectors[:, :p] / radius))  # 1 without a period
    if not relative_measure > _LEAST_CELL:
        raise InputError(
            f"the cell of crystal {name!r} has no room for a ball",
            f"Its vectors are too short for balls of {2.0 * radius:.4g} m, or not independent",
            "Give lengths in m",
        )


def scale_until_touch(structure: Lattice, site_balls: Sequence[Ball]) -> float:
    """Return the factor, m, by which a lattice whose neighbours are at distance one is scaled until
    the ``site_balls`` (n) on its n sites touch.

    Raises :class:`~granphon.base.errors.InputError` if neighbours cannot all touch.
    """
    radii = np.array([ball.radius for ball in site_balls])
    table = structure.contacts
    distances = radii[table.i] + radii[table.j]
    scale = float(np.mean(distances))
    if np.ptp(distances) > TOUCH * scale:
        # one scale for all contacts is not enough: the message names the shortest and the longest
        extreme_contacts = [int(np.argmin(distances)), int(np.argmax(distances))]
        texts = [
            f"those of sites {table.i[contact]} and {table.j[contact]} at"
            f" {distances[contact]:.6g} m"
            for contact in extreme_contacts
        ]
        raise InputError(
            f"balls of these sizes cannot all touch on the {structure.name} lattice",
            f"Centres would be apart: {', '.join(texts)}",
            "Give balls of one size, or a cell and places at which they touch",
        )
    return scale


def require_large_enough(structure: Lattice, cell: Array, kinds: Sequence[Ball]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the larger of two ``kinds`` of balls touch
    each other before they touch the smaller ones, in a ``cell`` (p, d), m, with one ball of each.
    """
    p = structure.periods
    steps = np.array(list(itertools.product((-1, 0, 1), repeat=p)))
    image_steps = steps[np.any(steps, axis=1)]  # without the ball itself
    image_distance = float(np.min(np.linalg.norm(image_steps @ cell, axis=1)))
    small_ball, large_ball = sorted(kinds, key=lambda ball: ball.diameter)
    if image_distance >= large_ball.diameter * (1.0 - TOUCH):
        return
    # the distance of unlike balls over that of images is fixed by the lattice; at the least small
    # diameter the images are one large diameter apart
    distance_ratio = 0.5 * (small_ball.diameter + large_ball.diameter) / image_distance
    least_diameter = 2.0 * large_ball.diameter * distance_ratio - large_ball.diameter
    name = small_ball.name or "AB"[kinds.index(small_ball)]
    ratio = small_ball.diameter / large_ball.diameter
    least_ratio = least_diameter / large_ball.diameter
    raise InputError(
        f"ball {name} of {small_ball.diameter:g} m is too small for its site in {structure.name}",
        f"The others, of {large_ball.diameter:g} m, touch each other before they touch it: the"
        f" ratio of the diameters is {ratio:.4g}, and must be {least_ratio:.4g} or more",
        f"Give it a diameter of {least_diameter:.6g} m or more",
    )
