"""Kinds of balls on the sites of a crystal: how they are told apart and named, and the structures that they make."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.ball import RIGID_PLANE, Ball
from granphon.balls.contact_table import TOUCH
from granphon.balls.lattices import LATTICES, Lattice, find_lattice
from granphon.base.errors import InputError, brief

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: structures of two kinds of balls, beside the lattices that have a name
_FACES = LATTICES["fcc"].vectors / np.max(LATTICES["fcc"].vectors)
STRUCTURES = {
    name: Lattice(name, tuple(map(tuple, cell)), ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)))
    for name, cell in (("NaCl", _FACES.tolist()), ("CsCl", (2.0 / math.sqrt(3.0) * np.eye(3)).tolist()))
} | {"zincblende": Lattice("zincblende", LATTICES["diamond"].cell, LATTICES["diamond"].sites)}


def list_balls(balls: Any) -> list[Any]:
    """Return balls, the argument of a public call, as a list; one ball is a list of one."""
    if isinstance(balls, str | Mapping | set | frozenset) or not isinstance(balls, Iterable | Ball):
        raise InputError(f"the balls are {brief(balls)}", mend="Give a list of granphon.Ball")
    return [balls] if isinstance(balls, Ball) else list(balls)


def find_kinds(balls: Sequence[Any]) -> tuple[tuple[Ball, ...], Index]:
    """Return the different balls in the order in which they come, and the number of the kind of each."""
    if not balls:
        raise InputError("there are no balls", mend="Give a list of granphon.Ball")
    of_object: dict[int, int] = {}
    kinds: dict[Ball, int] = {}
    out = []
    for ball in balls:
        at = of_object.get(id(ball))
        if at is None:
            if not isinstance(ball, Ball):
                raise InputError(f"{brief(ball)} is not a ball", mend="Give a granphon.Ball for each site")
            at = of_object[id(ball)] = kinds.setdefault(ball, len(kinds))
        out.append(at)
    return tuple(kinds), np.array(out, np.intp)


def name_kinds(kinds: Sequence[Ball], known: Mapping[Ball, str] | None = None) -> tuple[str, ...]:
    """Return the name of each kind: that which is known or its own, or the next of the letters A, B, C, ..."""
    names = {ball: (known or {}).get(ball) or ball.name for ball in kinds}
    taken = {name for name in names.values() if name} | {RIGID_PLANE.name}
    letters = (
        "".join(one) for size in itertools.count(1) for one in itertools.product("ABCDEFGHIJKLMNOPQRSTUVWXYZ", repeat=size)
    )
    free = (one for one in letters if one not in taken)
    found = tuple(names[ball] or next(free) for ball in kinds)
    if len(set(found)) < len(found) or RIGID_PLANE.name in found:
        twice = next(name for name in found if found.count(name) > 1 or name == RIGID_PLANE.name)
        raise InputError(f"two kinds are called {twice!r}", "Laws are given by names", "Name each kind differently")
    return found


def require_fit(balls: Sequence[Ball], cell: Array, name: str) -> None:
    """Raise :class:`InputError` if the larger of two balls of a cell touch each other before they touch the smaller."""
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * len(cell)), axis=-1).reshape(-1, len(cell))
    apart = float(np.min(np.linalg.norm(steps[np.any(steps, axis=1)] @ cell, axis=1)))
    small, large = sorted(balls, key=lambda ball: ball.diameter)
    if apart >= large.diameter * (1.0 - TOUCH):
        return
    least = 2.0 * large.diameter * (0.5 * (small.diameter + large.diameter) / apart) - large.diameter
    which = f"ball {small.name or 'AB'[balls.index(small)]} of {small.diameter:g} m is too small for its site in {name}"
    why = f"The others, of {large.diameter:g} m, touch each other before they touch it: the ratio of the diameters is"
    why += f" {small.diameter / large.diameter:.4g}, and must be {least / large.diameter:.4g} or more"
    raise InputError(which, why, f"Give it a diameter of {least:.6g} m or more")


def find_structure(name: str | Lattice) -> Lattice:
    """Return the lattice of a name, in any case of letters, that of NaCl, CsCl and zincblende among them."""
    known = {one.lower(): one for one in STRUCTURES}.get(name.lower()) if isinstance(name, str) else None
    if known is not None:
        return STRUCTURES[known]
    return find_lattice(name, [*LATTICES, *STRUCTURES])
