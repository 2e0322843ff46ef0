"""Compiled loops over the contacts of a grid, whose directions stay as they are at touch.

A cell has b balls, and each ball moves along d axes. Motions of balls, and forces on balls, are
arrays (f, cells) with f = b d: the line d ball + axis has the motion of one ball of each cell along
one axis. Arrays with one number of each contact are (kinds, cells). Blocks of balls are (d, d, n),
of n = b cells balls: first those of the first ball of all cells, then those of the second, and so
on. Loops work in the precision of their arguments. What is done for one run stands in each loop:
the call of a function would take as long as a short run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled
from granphon.contacts.grid import Runs
from granphon.contacts.grid_product import add_block_products

Values = NDArray[Any]
#: number of contacts of a run that are worked on at a time, so that they stay in the processor's
#: cache
_CONTACTS_AT_ONCE = 512
#: number of contacts of a grid up to which all tensions stay in the cache: 256 kB of them
_CONTACTS_IN_CACHE = 2**15
#: number of sums to which products are added in turn: the processor adds to one sum while it still
#: adds to the others
_LANES = 16


@compiled
def measure_losses(runs: Runs, motions: Values, loss: Values) -> None:
    """Set ``loss`` (kinds, cells) to n.(u_j - u_i): the overlap that each contact loses by the
    ``motions`` u (f, cells) of balls; n is the unit vector from ball i to ball j.
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
    """Add to ``on_balls`` (f, cells) the forces of contacts on both of their balls. The ``force``
    (kinds, cells) of a contact is above zero if it pushes the balls apart.
    """
    d = runs.normal.shape[1]
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        start = runs.table[run, 1]
        end = runs.table[run, 2]
        count = runs.table[run, 3]
        push = force[kind, start : start + count]
        for axis in range(d):
            component = runs.normal[kind, axis]
            if component == 0.0:
                continue
            near = on_balls[d * runs.ends[kind, 0] + axis, start : start + count]
            for contact in range(count):
                near[contact] -= component * push[contact]
            far = on_balls[d * runs.ends[kind, 1] + axis, end : end + count]
            for contact in range(count):
                far[contact] += component * push[contact]


@compiled
def resist(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    elongations: Values,
    forces: Values,
    tension_sums: Values,
) -> None:
    """Add to ``forces`` (f, cells) the forces C^T K (C u + e) that move balls by ``motions`` u (f,
    cells) against their contacts, whose ``stiffness`` (kinds, cells) is the diagonal of K. C u are
    the elongations n.(u_j - u_i) of contacts.

    ``elongations`` (kinds,) are those by strains of the cell, e. The sum of the tensions of each
    kind is added to ``tension_sums`` (kinds,). If the cell is held, both are (0,). The last digits
    of the sums depend on the number of contacts that are worked on at a time.
    """
    if stiffness.size <= _CONTACTS_IN_CACHE:
        _resist_at_once(runs, stiffness, motions, elongations, forces, tension_sums)
    else:
        _resist_by_parts(runs, stiffness, motions, elongations, forces, tension_sums)


@compiled
def _resist_at_once(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    elongations: Values,
    forces: Values,
    tension_sums: Values,
) -> None:
    """Do what :func:`resist` does, for so few contacts that all of their tensions stay in the
    cache: there, loops over whole runs that do one thing each take less time.
    """
    tensions = np.empty_like(stiffness)
    measure_losses(runs, motions, tensions)
    for kind in range(len(stiffness)):
        tension = tensions[kind]
        spring = stiffness[kind]
        # the difference is a zero in the precision of the springs: in single precision, the loop
        # does not go over to double precision
        elongation = elongations[kind] if len(elongations) else spring[0] - spring[0]
        for contact in range(len(spring)):
            tension[contact] = spring[contact] * (tension[contact] + elongation)
        if len(elongations):
            total = 0.0
            for contact in range(len(spring)):
                total += tension[contact]
            tension_sums[kind] += total
    # a tension pulls balls together; the forces that are asked for hold against it
    add_forces(runs, tensions, forces)


@compiled
def _resist_by_parts(
    runs: Runs,
    stiffness: Values,
    motions: Values,
    elongations: Values,
    forces: Values,
    tension_sums: Values,
) -> None:
    """Do what :func:`resist` does, for at most ``_CONTACTS_AT_ONCE`` contacts of a run at a time:
    their motions, tensions and forces stay in the cache.
    """
    d = runs.normal.shape[1]
    tension = np.empty(_CONTACTS_AT_ONCE, motions.dtype)
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        run_start = runs.table[run, 1]
        run_stop = run_start + runs.table[run, 3]
        # from the number of the cell where a contact starts to that of the cell where it ends
        offset = runs.table[run, 2] - run_start
        for start in range(run_start, run_stop, _CONTACTS_AT_ONCE):
            stop = min(start + _CONTACTS_AT_ONCE, run_stop)
            count = stop - start
            tension[:count] = 0.0
            for axis in range(d):
                component = runs.normal[kind, axis]
                if component == 0.0:
                    continue
                near = motions[d * runs.ends[kind, 0] + axis, start:stop]
                far = motions[d * runs.ends[kind, 1] + axis, start + offset : stop + offset]
                for contact in range(count):
                    tension[contact] += component * (far[contact] - near[contact])
            spring = stiffness[kind, start:stop]
            if len(elongations):
                elongation = elongations[kind]
                total = 0.0
                for contact in range(count):
                    tension[contact] = spring[contact] * (tension[contact] + elongation)
                for contact in range(count):
                    total += tension[contact]
                tension_sums[kind] += total
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
                far = forces[d * runs.ends[kind, 1] + axis, start + offset : stop + offset]
                for contact in range(count):
                    far[contact] += component * tension[contact]


@compiled
def add_blocks(runs: Runs, stiffness: Values, blocks: Values) -> None:
    """Add k nn of each contact to the ``blocks`` (d, d, n) of both of its balls; ``stiffness``
    (kinds, cells) is k, and n is the unit vector of the contact. Entries above the diagonal are
    left as they are. A contact of a ball with its own image adds nothing.
    """
    d = runs.normal.shape[1]
    cells = stiffness.shape[1]
    for run in range(len(runs.table)):
        kind = runs.table[run, 0]
        start = runs.table[run, 1]
        end = runs.table[run, 2]
        count = runs.table[run, 3]
        # numbers of the first balls i and j of the run
        first = runs.ends[kind, 0] * cells + start
        second = runs.ends[kind, 1] * cells + end
        if first == second:  # all contacts of the run join balls with their own images
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
    """Set ``inverses`` (d, d, n) to ``part`` times the inverses of symmetric ``blocks`` (d, d, n).

    The stiffness ``added`` is first added to the diagonal of each block. Blocks must be regular
    after that, which is not tested. Entries above their diagonals are not read.
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
def find_residual(
    runs: Runs, stiffness: Values, forces: Values, motions: Values, residual: Values
) -> None:
    """Set ``residual`` (f, cells) to the ``forces`` less those that move balls by ``motions``
    against their contacts, whose ``stiffness`` is (kinds, cells), while the cell is held; forces
    and motions are (f, cells).
    """
    residual[:] = 0.0
    no_strain = np.zeros(0, motions.dtype)
    resist(runs, stiffness, motions, no_strain, residual, no_strain)
    for field in range(len(forces)):
        pull = forces[field]
        remainder = residual[field]
        for cell in range(len(pull)):
            remainder[cell] = pull[cell] - remainder[cell]


@compiled
def relax_balls(
    runs: Runs,
    stiffness: Values,
    inverses: Values,
    forces: Values,
    motions: Values,
    residual: Values,
) -> None:
    """Set ``motions`` to those of each ball under the ``forces`` while its neighbours are held, by
    the ``inverses`` (d, d, n) of blocks, and ``residual`` to the forces that all these motions
    leave; see :func:`find_residual`.
    """
    motions[:] = 0.0
    _add_block_products(inverses, forces, motions)
    find_residual(runs, stiffness, forces, motions, residual)


@compiled
def relax_balls_after(
    runs: Runs,
    stiffness: Values,
    inverses: Values,
    forces: Values,
    motions: Values,
    residual: Values,
) -> None:
    """Add to ``motions`` those of each ball under the forces that are left of ``forces`` while its
    neighbours are held; see :func:`relax_balls`. The forces left before these motions become the
    ``residual``.
    """
    find_residual(runs, stiffness, forces, motions, residual)
    _add_block_products(inverses, residual, motions)


@compiled
def _add_block_products(blocks: Values, forces: Values, motions: Values) -> None:
    """Add to ``motions`` (f, cells) the products of the ``blocks`` (d, d, n) of balls with the
    ``forces`` (f, cells) on them.
    """
    one_side = (len(forces), 1, forces.shape[1])
    add_block_products(blocks, forces.reshape(one_side), motions.reshape(one_side))


@compiled
def find_scalar_product(first: Values, second: Values) -> float:
    """Return the scalar product of two vectors of the same length. Products have the precision of
    the vectors, and their sums are in double precision.
    """
    sums = np.zeros(_LANES)
    # whole groups of products are added to all sums; the products left over are added at the end
    n_grouped = len(first) - len(first) % _LANES
    for start in range(0, n_grouped, _LANES):
        for lane in range(_LANES):
            sums[lane] += first[start + lane] * second[start + lane]
    total = 0.0
    for lane in range(_LANES):
        total += sums[lane]
    for place in range(n_grouped, len(first)):
        total += first[place] * second[place]
    return total


@compiled
def take_conjugate_step(
    runs: Runs,
    stiffness: Values,
    unit_elongations: Values,
    preconditioned: Values,
    last_product: float,
    direction: Values,
    resistance: Values,
    solution: Values,
    residual: Values,
) -> tuple[float, float, float]:
    """Take a step of conjugate gradients. Return the scalar product of the ``residual`` before the
    step with the ``preconditioned`` residual, the curvature along the new ``direction``, and the
    square of the residual after the step.

    If the curvature is zero or below, no step is taken, and the square is returned as zero.
    Vectors (f cells + s,) have the motions of balls, field by field, and s strains of the cell, or
    the forces on these.

    Parameters
    ----------
    runs : the runs of all contacts.
    stiffness : (kinds, cells) stiffnesses of contacts.
    unit_elongations : (kinds, s) elongations of contacts by unit strains; (kinds, 0) if the cell is
        held.
    preconditioned : approximate inverse times the residual.
    last_product : scalar product that the step before has returned; zero at first.
    direction : direction of the step before, zeros at first; set to that of this step.
    resistance : set to the forces against a unit step along the direction.
    solution, residual : solution and residual before the step, set to those after it.
    """
    kinds, cells = stiffness.shape
    s = unit_elongations.shape[1]
    n_motions = len(direction) - s
    fields = n_motions // cells
    product = find_scalar_product(residual, preconditioned)
    factor = product / last_product if last_product else 0.0
    for place in range(len(direction)):
        direction[place] = factor * direction[place] + preconditioned[place]
    elongations = np.zeros(kinds if s else 0, direction.dtype)
    tension_sums = np.zeros(kinds if s else 0, direction.dtype)
    for strain in range(s):
        for kind in range(kinds):
            elongations[kind] += unit_elongations[kind, strain] * direction[n_motions + strain]
    resistance[:] = 0.0
    motions = direction[:n_motions].reshape((fields, cells))
    forces = resistance[:n_motions].reshape((fields, cells))
    resist(runs, stiffness, motions, elongations, forces, tension_sums)
    for strain in range(s):
        for kind in range(kinds):
            resistance[n_motions + strain] += unit_elongations[kind, strain] * tension_sums[kind]
    curvature = find_scalar_product(direction, resistance)
    if curvature <= 0.0:
        return product, curvature, 0.0
    length = product / curvature
    for place in range(len(direction)):
        solution[place] += length * direction[place]
    for place in range(len(direction)):
        residual[place] -= length * resistance[place]
    return product, curvature, find_scalar_product(residual, residual)
