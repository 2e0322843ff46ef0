"""Plane waves on a network: the wave vectors that its cell has, their polarisations, and the vectors of the operator."""

from __future__ import annotations

import itertools
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, PrecisionError, brief, message
from granphon.base.validation import choice, finite_array, require
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator
from granphon.waves.settings import POLARISATIONS

Array = NDArray[np.float64]
#: largest deviation of q . L / 2 pi from a whole number that is put down to rounding
_WHOLE = 1e-6
#: largest phase of a wave across a network, rad: of a larger one no digit within a turn is left
_MOST_PHASE = 1e15
#: length of the part of a direction across q, over that of the direction, below which there is none
_ACROSS = 1e-9
#: greatest common denominator of the sites of a lattice, in fractions of its vectors, that is looked for
_MOST_PARTS = 24


class PeriodicCell(NamedTuple):
    """The cell of a network, without its balls: vectors (3, 3), m, which of them are periods, and the dimension."""

    cell: Array
    pbc: tuple[bool, bool, bool]
    dimension: int


# -- wave vectors -------------------------------------------------------------------------------------------------------


def read_wavevectors(network: ContactNetwork, q: ArrayLike) -> Array:
    """Return ``q`` as (n, d), 1/m; along axes with a period the wave vectors are those that the cell has, to rounding.

    Raises :class:`~granphon.base.errors.InputError` for another shape, and for a q that the cell does not have.
    """
    given = _as_wavevectors(network, q)
    nearest = _round(network, given)
    periods = network.cell[list(network.pbc), : network.dimension]
    wrong = np.abs((given - nearest) @ periods.T) > 2.0 * np.pi * _WHOLE * np.maximum(1.0, np.abs(nearest @ periods.T))
    if np.any(wrong):
        bad = int(np.argmax(np.any(wrong, axis=1)))
        wanted, there = ("(" + ", ".join(f"{one:.9g}" for one in vector) + ")" for vector in (given[bad], nearest[bad]))
        what, why = f"q = {wanted} is no wave vector of the periodic cell", "Along each of its vectors L, q . L must be"
        mend = f"The nearest is {there} 1/m; waves.nearest_wavevectors(q) finds it for any q"
        raise InputError(message(what, f"{why} a multiple of 2 pi", mend))
    return nearest


def nearest_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    """Return the wave vectors nearest to ``q`` (d,) or (n, d), 1/m, that the periodic cell has, in the same shape."""
    given = _as_wavevectors(network, q)
    return np.asarray(_round(network, given).reshape(np.shape(q)))


def fold_wavevectors(network: ContactNetwork, q: Array) -> Array | None:
    """Return for wave vectors ``q`` (n, d) of a lattice the shortest, 1/m, in whose waves all balls move as in those of q.

    They differ from q by reciprocal vectors G with exp(i G . t) = 1 for the steps t between all balls of a cell. With one
    ball in a cell these are all G, and the shortest lies in the first zone; along the axis of hcp every second one is such.
    None for a network of no lattice, and for a lattice whose sites are no multiples of a 24th, or of a larger part, of the
    lattice vectors.
    """
    if network.lattice is None or network.shape is None:
        return None
    periods = len(network.shape)
    # steps between the balls of a cell, in fractions of the lattice vectors, and their least common denominator m
    sites = network.lattice.positions @ np.linalg.pinv(network.lattice.vectors)
    steps = sites - sites[0]
    denominators = (m for m in range(1, _MOST_PARTS + 1) if np.all(np.abs(m * steps - np.round(m * steps)) <= _WHOLE))
    if (m := next(denominators, None)) is None:
        return None
    # reciprocal vectors, as whole numbers, that span all G with exp(i G . t) = 1: m times any reciprocal vector is one of
    # them, so that those from 0 to m have a triangular basis among them
    numbers = np.stack(np.meshgrid(*[np.arange(m + 1)] * periods, indexing="ij"), axis=-1).reshape(-1, periods)
    numbers = numbers[np.all((numbers @ np.round(m * steps).astype(int).T) % m == 0, axis=1)]
    repeats = np.zeros((periods, periods), np.intp)
    for n in range(periods):
        among = numbers[~np.any(numbers[:, :n], axis=1) & (numbers[:, n] > 0)]
        repeats[n] = among[np.argmin(among[:, n])]
    primitive = network.cell[:periods, : q.shape[1]] / np.array(network.shape)[:, None]
    return q - _find_nearest(np.linalg.inv(repeats).T @ primitive, q)


def _as_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    given, d = finite_array("q", q, "1/m"), network.dimension
    if d == 1 and given.ndim == 0:
        given = given.reshape(1)
    if given.ndim not in (1, 2) or given.shape[-1] != d:
        why, mend = f"A wave vector of this network has the shape ({d},)", f"Give ({d},) or (n, {d}), Cartesian, in 1/m"
        raise InputError(message(f"q has the shape {given.shape}", why, mend))
    size = float(np.max(np.abs(network.cell), initial=0.0) + np.ptp(getattr(network, "positions", 0.0)))
    if (phase := float(np.max(np.abs(given), initial=0.0)) * size) > _MOST_PHASE:
        what = f"the phase of such a wave differs by {phase:.1e} across the network"
        raise PrecisionError(
            message(what, f"Beyond {_MOST_PHASE:.0e} its digits within a turn are lost", "Give a shorter q")
        )
    return np.atleast_2d(given)


def _round(network: ContactNetwork | PeriodicCell, q: Array) -> Array:
    """Return the wave vectors (n, d) of the cell nearest to ``q``."""
    periods = network.cell[list(network.pbc), : network.dimension]
    if not len(periods):
        return q
    found = _find_nearest(periods, q)
    if len(periods) < network.dimension:
        found += q - q @ np.linalg.pinv(periods) @ periods  # across the periods nothing moves
    return found


def _find_nearest(periods: Array, q: Array) -> Array:
    """Return the wave vectors (n, d) that are nearest to ``q`` among those that repeat with ``periods`` (p, d)."""
    from ase.geometry.minkowski_reduction import minkowski_reduce

    back = np.asarray(np.linalg.pinv(periods).T, float)  # (p, d) rows b with b_i . L_j = delta_ij
    # whole numbers (p, p) that make a basis one of Minkowski's, of the shortest vectors: only around these are the lattice
    # points nearest to a point among the corners of its cell and of the cells next to it
    (p, d), full = back.shape, np.zeros((3, 3))
    full[:p, :d] = back / np.linalg.norm(back, axis=1).max()  # ASE's tolerance is a length
    shorter = np.asarray(minkowski_reduce(full, pbc=np.arange(3) < p)[1][:p, :p], np.intp)
    waves = q @ periods.T @ np.linalg.inv(shorter) / (2.0 * np.pi)
    around = np.floor(waves)[:, None] + np.array(list(itertools.product((-1.0, 0.0, 1.0, 2.0), repeat=len(periods))))
    least = np.argmin(np.sum(((around - waves[:, None]) @ (shorter @ back)) ** 2, axis=-1), axis=1)
    # from whole numbers, not as a step from q: then the same wave vector has the same digits, and Gamma is zero
    return np.asarray(2.0 * np.pi * (around[np.arange(len(q)), least] @ shorter) @ back + 0.0)


# -- polarisations ------------------------------------------------------------------------------------------------------


def find_polarisations(
    operator: WaveOperator, q: Array, polarisation: str | ArrayLike, direction: ArrayLike | None
) -> Array:
    """Return the polarisations of a wave, (b, motions): orthonormal rows, over which a spectral function is averaged.

    Raises :class:`~granphon.base.errors.InputError` if the balls do not move that way, or if it is not said which way.
    """
    motions = operator.motions
    letters = ", ".join(motions.letters)
    if not isinstance(polarisation, str):  # numbers, one for each displacement or one for each motion
        numbers, sizes = finite_array("polarisation", polarisation), (len(motions.translations), motions.count)
        if direction is not None:
            raise InputError(message("a direction is given besides the polarisation by numbers", "They say the same"))
        if numbers.ndim != 1 or numbers.size not in sizes or not np.any(numbers):
            why = f"By numbers it is {sizes[0]} displacements, or all {sizes[1]} motions {letters}"
            mend = f"Give these, not all zero, or one of {', '.join(POLARISATIONS)}"
            raise InputError(message(f"the polarisation is {brief(polarisation)}", why, mend))
        rows = np.zeros((1, motions.count))
        numbers = numbers / np.max(np.abs(numbers))
        rows[0, : numbers.size] = numbers / np.linalg.norm(numbers)
        return rows
    name = require("polarisation", partial(choice, options=POLARISATIONS), polarisation)
    turns = name == "rotational"
    axes = motions.rotations if turns else motions.translations
    free = np.eye(3)[list(axes)]  # (a, 3) directions in which balls move
    wanted = None
    if direction is not None:
        given = finite_array("direction", direction)
        if given.shape not in ((2,), (3,)) or not np.any(given):
            raise InputError(message(f"direction is {brief(direction)}", mend="Give (x, y) or (x, y, z), not all zero"))
        wanted = np.zeros(3)
        wanted[: given.size] = given / np.max(np.abs(given))
        wanted /= np.linalg.norm(wanted)
    along = np.zeros(3)
    along[: q.size] = q
    if turns:
        found = free if wanted is None else (wanted @ free.T) @ free
    elif not np.any(q):
        if wanted is None:
            mend = "Give direction=, the one in which balls move"
            raise InputError(message(f"a {name} wave with q = 0 has no direction", mend=mend))
        found = wanted
    else:
        along /= np.linalg.norm(along)
        if name == "longitudinal":
            found = along
        elif wanted is not None:
            found = wanted - (wanted @ along) * along
            if np.linalg.norm(found) < _ACROSS:
                raise InputError(message(f"the direction {brief(direction)} of a transverse wave is along q"))
        else:  # orthonormal directions across q: within the plane of the balls, if they move there
            for among in (free[np.argmax(free, axis=1) < operator.network.dimension], free):
                left = among - (among @ along)[:, None] * along
                _, across, basis = np.linalg.svd(left) if len(left) else (None, np.zeros(0), free)
                found = basis[: across.size][across > 0.5]
                if len(found):
                    break
    # directions (b, 3) as rows (b, motions) of unit length
    found = np.atleast_2d(found)
    if not len(found) or not axes or np.max(np.abs(np.delete(found, axes, axis=1)), initial=0.0) > _ACROSS:
        raise InputError(message(f"no {name} wave of this direction runs here", f"Balls move in {letters} alone"))
    size = np.linalg.norm(found, axis=1, keepdims=True)
    if np.any(size < _ACROSS):
        raise InputError(message(f"the direction of a {name} wave is across all motions {letters}"))
    rows = np.zeros((len(found), motions.count))
    rows[:, motions.turning if turns else motions.translating] = (found / size)[:, list(axes)]
    return rows


# -- vectors ------------------------------------------------------------------------------------------------------------


def make_plane_wave(operator: WaveOperator, q: Array, polarisation: Array, sine: bool) -> Array:
    """Return the vector (size,) of balls that all move with the velocity cos(q . r), or sin(q . r), times ``polarisation``.

    Vectors are weighted with masses: displacements, and rotations given with them, by the root of the mass, so that q = 0
    is the motion of all balls together. In a wave of rotations alone balls turn at that rate, weighted by the root of the
    moment of inertia. Balls that touch none take no part, as no wave reaches them.
    """
    network, balls = operator.network, operator.balls
    touching = np.zeros(network.n_balls, bool)
    touching[network.i] = touching[network.j] = True
    turns = not np.any(polarisation[operator.motions.translating])
    weight = np.sqrt((network.inertias if turns else network.masses)[balls])
    phase = network.positions[balls, : q.size] @ q
    wave = np.where(touching[balls], weight * (np.sin(phase) if sine else np.cos(phase)), 0.0)
    return np.asarray(operator.vector(wave[:, None] * polarisation))
