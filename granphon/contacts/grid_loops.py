"""Loops over the contacts of a grid that keep their directions, compiled.

Motions of balls and forces on them are arrays (f, cells), of the d axes of each ball of the cell;
numbers of contacts are (kinds, cells). Loops work in the precision of their arguments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled
from granphon.contacts.grid import Runs

Values = NDArray[Any]
#: number of contacts of a run that are worked on at a time, so that they stay in the processor's
#: cache
_CACHED = 512
#: number of contacts of a grid up to which all tensions stay in the cache: 256 kB of them
_SMALL = 2**15
#: number of sums into which products are added in turn: a sum need not wait for the one before it
_LANES = 16


@compiled
def measure_losses(runs: Runs, motions: Values, loss: Values) -> None:
    """Set ``loss`` (kinds, cells) to n.(u_j - u_i), the loss of overlap of each contact by the
    ``motions`` (f, cells) of balls.
    """
    d = runs.normal.shape[1]
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        start = runs.table[run, 1]
        end = runs.table[run, 2]
        count = runs.table[run, 3]
        losses = loss[kind, start : start + count]
        losses[:] = 0.0
        for axis in range(d):
            component = runs.normal[kind, axis]
            if component == 0.0:
                continue
            near = motions[d * runs.ends[kind, 0] + axis, start : start + count]
            far = motions[d * runs.ends[kind, 1] + axis, end : end + count]
            for contact in range(count):
                losses[contact] += component * (far[contact] - near[contact])


@compiled
def add_forces(runs: Runs, force: Values, on_balls: Values) -> None:
    """Add to ``on_balls`` (f, cells) the forces of contacts on their balls: ``force`` (kinds,
    cells) is above zero where balls are pushed apart.
    """
    d = runs.normal.shape[1]
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        start = runs.table[run, 1]
        end = runs.table[run, 2]
        count = runs.table[run, 3]
        pushing = force[kind, start : start + count]
        for axis in range(d):
            component = runs.normal[kind, axis]
            if component == 0.0:
                continue
            near = on_balls[d * runs.ends[kind, 0] + axis, start : start + count]
            for contact in range(count):
                near[contact] -= component * pushing[contact]
            far = on_balls[d * runs.ends[kind, 1] + axis, end : end + count]
            for contact in range(count):
                far[contact] += component * pushing[contact]


@compiled
def resist(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    strained: Values,
    forces: Values,
    tensions: Values,
) -> None:
    """Add to ``forces`` (f, cells) the forces that balls need to make ``motions`` (f, cells)
    against contacts of a ``stiffness`` (kinds, cells): C^T K (C u + e).

    ``strained`` (kinds,) are the elongations e of contacts by strains of the cell, and the sums of
    the tensions of each kind are added to ``tensions`` (kinds,). If the cell is held, both are
    (0,). The sums depend in their last digits on how many contacts are worked on at a time.
    """
    if stiffness.size <= _SMALL:
        _resist_at_once(runs, stiffness, motions, strained, forces, tensions)
    else:
        _resist_by_parts(runs, stiffness, motions, strained, forces, tensions)


@compiled
def _resist_at_once(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    strained: Values,
    forces: Values,
    tensions: Values,
) -> None:
    """Do what :func:`resist` does, where the tensions of all contacts stay in the cache: loops over
    whole runs that do one thing each take less time there.
    """
    tension_of_all = np.empty_like(stiffness)
    measure_losses(runs, motions, tension_of_all)
    for kind in range(len(stiffness)):
        tension = tension_of_all[kind]
        spring = stiffness[kind]
        # a zero of the precision of the springs, so that no loop is in another one
        elongation = strained[kind] if len(strained) else spring[0] - spring[0]
        for contact in range(len(spring)):
            tension[contact] = spring[contact] * (tension[contact] + elongation)
        if len(strained):
            total = 0.0
            for contact in range(len(spring)):
                total += tension[contact]
            tensions[kind] += total
    add_forces(runs, tension_of_all, forces)


@compiled
def _resist_by_parts(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    strained: Values,
    forces: Values,
    tensions: Values,
) -> None:
    """Do what :func:`resist` does, for ``_CACHED`` contacts of a run at a time: their motions,
    tensions and forces stay in the cache.
    """
    d = runs.normal.shape[1]
    tension = np.empty(_CACHED, motions.dtype)
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        last = runs.table[run, 1] + runs.table[run, 3]
        ahead = runs.table[run, 2] - runs.table[run, 1]
        for start in range(runs.table[run, 1], last, _CACHED):
            stop = min(start + _CACHED, last)
            count = stop - start
            tension[:count] = 0.0
            for axis in range(d):
                component = runs.normal[kind, axis]
                if component == 0.0:
                    continue
                near = motions[d * runs.ends[kind, 0] + axis, start:stop]
                far = motions[d * runs.ends[kind, 1] + axis, start + ahead : stop + ahead]
                for contact in range(count):
                    tension[contact] += component * (far[contact] - near[contact])
            spring = stiffness[kind, start:stop]
            if len(strained):
                elongation = strained[kind]
                total = 0.0
                for contact in range(count):
                    tension[contact] = spring[contact] * (tension[contact] + elongation)
                for contact in range(count):
                    total += tension[contact]
                tensions[kind] += total
            else:
                for contact in range(count):
                    tension[contact] *= spring[contact]
            for axis in range(d):
                component = runs.normal[kind, axis]
                if component == 0.0:
                    continue
                near = forces[d * runs.ends[kind, 0] + axis, start:stop]
                for contact in range(count):
                    near[contact] -= component * tension[contact]
                far = forces[d * runs.ends[kind, 1] + axis, start + ahead : stop + ahead]
                for contact in range(count):
                    far[contact] += component * tension[contact]


@compiled
def add_blocks(runs: Runs, stiffness: Values, blocks: Values) -> None:
    """Add k nn of each contact, with its ``stiffness`` k (kinds, cells), to the ``blocks`` (d, d,
    n) of both balls; only entries up to the diagonal are set. A contact of a ball with its own
    image adds nothing.
    """
    d = runs.normal.shape[1]
    cells = stiffness.shape[1]
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        start = runs.table[run, 1]
        end = runs.table[run, 2]
        count = runs.table[run, 3]
        first = runs.ends[kind, 0] * cells + start
        second = runs.ends[kind, 1] * cells + end
        if first == second:
            continue
        spring = stiffness[kind, start : start + count]
        for line in range(d):
            for column in range(line + 1):
                entry = runs.normal[kind, line] * runs.normal[kind, column]
                near = blocks[line, column, first : first + count]
                for contact in range(count):
                    near[contact] += entry * spring[contact]
                far = blocks[line, column, second : second + count]
                for contact in range(count):
                    far[contact] += entry * spring[contact]


@compiled
def invert_blocks(blocks: Values, added: float, part: float, inverses: Values) -> None:
    """Set ``inverses`` (d, d, n) to ``part`` times the inverses of symmetric ``blocks`` (d, d, n),
    to whose diagonals the stiffness ``added`` is added first, and which must then be regular; only
    entries up to the diagonal are read.
    """
    d = len(blocks)
    for ball in range(blocks.shape[2]):
        if d == 1:
            inverses[0, 0, ball] = part / (blocks[0, 0, ball] + added)
        elif d == 2:
            xx = blocks[0, 0, ball] + added
            xy = blocks[1, 0, ball]
            yy = blocks[1, 1, ball] + added
            scale = part / (xx * yy - xy * xy)
            inverses[0, 0, ball] = scale * yy
            inverses[1, 1, ball] = scale * xx
            inverses[0, 1, ball] = -scale * xy
            inverses[1, 0, ball] = -scale * xy
        else:
            xx = blocks[0, 0, ball] + added
            xy = blocks[1, 0, ball]
            xz = blocks[2, 0, ball]
            yy = blocks[1, 1, ball] + added
            yz = blocks[2, 1, ball]
            zz = blocks[2, 2, ball] + added
            # cofactors of the first row
            cofactor_x = yy * zz - yz * yz
            cofactor_y = xz * yz - xy * zz
            cofactor_z = xy * yz - xz * yy
            scale = part / (xx * cofactor_x + xy * cofactor_y + xz * cofactor_z)
            inverses[0, 0, ball] = scale * cofactor_x
            inverses[0, 1, ball] = scale * cofactor_y
            inverses[1, 0, ball] = scale * cofactor_y
            inverses[0, 2, ball] = scale * cofactor_z
            inverses[2, 0, ball] = scale * cofactor_z
            inverses[1, 1, ball] = scale * (xx * zz - xz * xz)
            inverses[1, 2, ball] = scale * (xy * xz - xx * yz)
            inverses[2, 1, ball] = scale * (xy * xz - xx * yz)
            inverses[2, 2, ball] = scale * (xx * yy - xy * xy)


@compiled
def add_alone(alone: Values, forces: Values, motions: Values) -> None:
    """Add to ``motions`` (f, cells) the product of the block (d, d) of each ball with the
    ``forces`` (f, cells) on that ball alone.

    The blocks ``alone`` (d, d, n) are those of the first ball of all cells, then those of the
    second, and so on.
    """
    d = len(alone)
    cells = forces.shape[1]
    for ball in range(len(forces) // d):
        for line in range(d):
            moved = motions[ball * d + line]
            for column in range(d):
                block = alone[line, column, ball * cells : (ball + 1) * cells]
                pull = forces[ball * d + column]
                for cell in range(cells):
                    moved[cell] += block[cell] * pull[cell]


@compiled
def leave(
    runs: Runs, stiffness: Values, forces: Values, motions: Values, remaining: Values
) -> None:
    """Set ``remaining`` (f, cells) to the ``forces`` less those that balls need to make ``motions``
    against contacts of a ``stiffness`` (kinds, cells) while the cell is held.
    """
    remaining[:] = 0.0
    none = np.zeros(0, motions.dtype)
    resist(runs, stiffness, motions, none, remaining, none)
    for field in range(len(forces)):
        pull = forces[field]
        remainder = remaining[field]
        for cell in range(len(pull)):
            remainder[cell] = pull[cell] - remainder[cell]


@compiled
def multiply(first: Values, second: Values) -> float:
    """Return the sum of the products of the numbers of two vectors (n,)."""
    sums = np.zeros(_LANES)
    whole = len(first) - len(first) % _LANES
    for start in range(0, whole, _LANES):
        for lane in range(_LANES):
            sums[lane] += first[start + lane] * second[start + lane]
    total = 0.0
    for lane in range(_LANES):
        total += sums[lane]
    for place in range(whole, len(first)):
        total += first[place] * second[place]
    return total


@compiled
def go_on(
    runs: Runs,
    stiffness: Values,
    strained: Values,
    preconditioned: Values,
    last: float,
    direction: Values,
    change: Values,
    solution: Values,
    remaining: Values,
) -> tuple[float, float, float]:
    """Take a step of conjugate gradients. Return the product of the ``remaining`` forces before the
    step with the ``preconditioned`` motions, the curvature along the new ``direction``, and the
    square of the forces that remain after the step.

    Where the curvature is not above zero, no step is taken, and the square is given as zero.
    Vectors (n + s,) are motions of balls, field by field, and strains of the cell, or forces on
    both.

    Parameters
    ----------
    stiffness : (kinds, cells) stiffnesses of contacts.
    strained : (kinds, s) elongations of contacts by unit strains; (kinds, 0) if the cell is held.
    preconditioned : approximate inverse times the ``remaining`` forces.
    last : product that the step before has returned; zero at first.
    direction : direction of the step before, zeros at first; set to that of this step.
    change : set to the forces against a unit step along the direction.
    solution, remaining : motions and remaining forces before the step, set to those after it.
    """
    kinds, cells = stiffness.shape
    s = strained.shape[1]
    n = len(direction) - s
    fields = n // cells
    product = multiply(remaining, preconditioned)
    factor = product / last if last else 0.0
    for place in range(len(direction)):
        direction[place] = factor * direction[place] + preconditioned[place]
    elongations = np.zeros(kinds if s else 0, direction.dtype)
    tensions = np.zeros(kinds if s else 0, direction.dtype)
    for strain in range(s):
        for kind in range(kinds):
            elongations[kind] += strained[kind, strain] * direction[n + strain]
    change[:] = 0.0
    motions = direction[:n].reshape((fields, cells))
    forces = change[:n].reshape((fields, cells))
    resist(runs, stiffness, motions, elongations, forces, tensions)
    for strain in range(s):
        for kind in range(kinds):
            change[n + strain] += strained[kind, strain] * tensions[kind]
    curvature = multiply(direction, change)
    if curvature <= 0.0:
        return product, curvature, 0.0
    length = product / curvature
    for place in range(len(direction)):
        solution[place] += length * direction[place]
    for place in range(len(direction)):
        remaining[place] -= length * change[place]
    return product, curvature, multiply(remaining, remaining)
