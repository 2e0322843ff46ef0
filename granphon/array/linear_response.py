"""Linear response of an array at rest: small motions of balls under forces, and elastic constants
under stress.

Where contacts keep the directions of the lattice, the balls follow tensions of their contacts:
conjugate gradients solve C^T K C u = C^T t. In single precision an iteration takes half of the
time; what its solution leaves is found in double precision, and solved for again. Where that does
not come nearer, as close to the rigidity threshold, the iteration itself goes on in double
precision.

In the true geometry what changes forces by a small motion is C^T D C and the forces that act, which
turn with their contacts (:meth:`granphon.array.geometry.ExactPlace.respond`). Without tangential
forces the operator is symmetric, and conjugate gradients solve it; with them GMRES does. The
lattice's Green's function, or the factors of :mod:`granphon.array.preconditioners`, precondition
both: geometry changes the operator by a part of order W/d. A ball whose contacts all slide, or a
row of balls that roll on each other, is held by no springs. What is left are the forces that act
and turn with their contacts, W/d of the others. The preconditioners of the lattice know nothing of
these, and iterations with them hardly come to an end. So what the forces do to each ball alone is
added to the preconditioner of the lattice. In space rows of balls roll, of which a ball alone knows
nothing: there the whole matrix is factorised (sparse LU). The matrix of a small array is factorised
at once, which takes less time than iterations without factors; that of a larger one where
iterations do not come to an end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from granphon.array.geometry import ActingForces, ExactPlace, Inverse
from granphon.array.krylov import KEPT, Map, Single, conjugate_gradients
from granphon.array.preconditioners import Preconditioners
from granphon.array.sparse_matrices import compose_hessian
from granphon.array.stencils import Motion, Stencils, dot
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.dynamics.elasticity import find_stress_part, voigt_pairs
from granphon.dynamics.factors import factorise

#: largest number of iterations for a linear response
_MOST_ITERATIONS = 60_000
#: the least reduction that is asked of single precision at a time
_SINGLE = 1e-4
#: part of the energy of what was left before, from which single precision comes no nearer
_STALLED = 1e-2
#: fraction of a tension or a force that rounding may leave unbalanced
_NOISE = 1e-14
#: relative residual of linear responses in the true geometry; the error of a stiffness is its
#: square, without tangential forces
_RESPONSE = 1e-7
#: cycles of GMRES after which the matrix is factorised
_PATIENCE = 4
#: largest number of contacts that carry load, in a plane and in space, of an array whose matrix is
#: factorised at once: where factors take less time than iterations without, by trial (8^3 cells in
#: fcc: about as long near the threshold, ten times as long where all contacts carry)
_MOST_AT_ONCE = (2700, 2200)
#: largest number of balls whose matrix is factorised where iterations without factors do not come
#: to an end. In space the time grows as the power 2.5 of it: 1000 balls take about 2 s, 1728 about
#: 10 s; in a plane 16,384 about 1 s
_MOST_BALLS = (2**14, 2**11)
#: regularisation added to the diagonal, over the mean stiffness: it fixes zero modes such as balls
#: that turn against each other like gears, which what is left of torques, rounding among it, would
#: turn without limit
_HOLDING = 1e-10


def find_linear_response(
    stencils: Stencils, springs: Array, tensions: Iterable[Array], reduction: float
) -> list[Array]:
    """Return the motions u (fields, L1, ..., Lp) that solve C^T K C u = C^T t for each of the
    ``tensions`` t of contacts.

    The stiffnesses ``springs`` and tensions are (rows, L1, ..., Lp). A stiffness is zero where
    balls are apart; there the tensions must be zero too. The error of u in the energy norm is about
    ``reduction`` times u. Raises
    :class:`~granphon.base.errors.ConvergenceError` if conjugate gradients do not converge.
    """
    mean = float(np.mean(springs[: stencils.n_contacts]))
    single: Single = (springs / mean).astype(np.float32)  # which has no numbers below 1e-38
    product = stencils.hessian(single)
    inverse = Preconditioners(stencils).choose(single, hard=True, product=product)

    def pull(tension: Array) -> Array:  # forces on balls, over the mean stiffness
        return stencils.forces(tension) / mean

    def square(values: Array) -> float:  # of an array that is not kept
        return dot(values, values)

    def precondition(force: Single) -> Single:
        return inverse(force.astype(np.float32, copy=False)).astype(force.dtype, copy=False)

    motions = []
    for tension in tensions:
        rest = pull(tension)
        found = np.zeros_like(rest)
        taken = 0
        before = math.inf
        left = dot(rest, precondition(rest))
        # a tension that is in balance except for rounding moves nothing; squares of the smallest
        # ones would vanish
        aim = max(reduction**2 * left, _NOISE**2 * square(tension / mean))
        while aim < left < _STALLED * before:
            ahead = max(math.sqrt(aim / left), _SINGLE)
            given = rest.astype(np.float32)
            most = _MOST_ITERATIONS - taken
            change, count, _ = conjugate_gradients(
                lambda balls: product(balls)[0], precondition, given, ahead, most
            )
            found = found + change
            taken = taken + count
            rest = pull(tension - springs * stencils.operator.deform(found))
            before = left
            left = dot(rest, precondition(rest))
        if left > aim:
            ahead = math.sqrt(aim / left)
            most = _MOST_ITERATIONS - taken
            change, count, _ = conjugate_gradients(
                lambda balls: pull(springs * stencils.operator.deform(balls)),
                precondition,
                rest,
                ahead,
                most,
            )
            if count == most:
                what = f"the linear response of the sample is not found in {_MOST_ITERATIONS} steps"
                raise ConvergenceError(what, mend="Raise the load")
            found += change
        motions.append(found)
    return motions


def find_motions(
    place: ExactPlace, acting: ActingForces, stencils: Stencils, springs: Array
) -> Callable[[Array], Array]:
    """Return what finds the motion (fields, L1, ..., Lp) by which the balls follow small forces on
    them.

    ``springs`` (rows, L1, ..., Lp) are the stiffnesses of all deformations of the ``stencils``, for
    preconditioners. The motion is not found where :class:`~granphon.base.errors.ConvergenceError`
    is raised.
    """
    from scipy.sparse import eye_array  # imported here: most simulations do not need it

    frame, symmetric = place.geometry.frame, not np.any(acting.shears)
    stiff, count = (
        float(np.mean(springs[: stencils.n_contacts])),
        math.prod(frame.shape) * frame.n_balls,
    )
    carrying = int(np.count_nonzero(springs[: stencils.n_contacts]))
    where = len(frame.shape) - 2
    small = carrying <= _MOST_AT_ONCE[where]
    few = count <= _MOST_BALLS[where]

    # the product of a symmetric matrix is made of its rows: an assembled one has rounding along
    # motions that nothing holds, which may count as curvature below zero
    table = np.array(list(place.tabulate(acting))) if symmetric else None
    product = None if table is None else frame.couple(table)
    matrix: Any = None
    if small if symmetric else few:
        matrix = compose_hessian(
            frame, np.array(list(place.tabulate(acting))) if table is None else table
        )
    held = (
        None
        if matrix is None
        else matrix + _HOLDING * stiff * eye_array(matrix.shape[0], format="csc")
    )

    def offer_inverses() -> Iterator[tuple[Inverse, int]]:
        """Yield preconditioners, each with the number of iterations after which the next one is
        taken, if there is one.
        """
        if held is not None and small:
            factors = _factorise(frame, held, symmetric)
            if factors:
                yield factors, _MOST_ITERATIONS
                return
        whole = Preconditioners(stencils).choose(springs, hard=True)
        if symmetric:  # it has to be positive definite
            yield whole, _MOST_ITERATIONS
            return
        alone = _invert_balls(frame, stiff, place.tabulate(acting))
        yield (
            lambda force: whole(force) + alone(force),
            _MOST_ITERATIONS if held is None else _PATIENCE * KEPT,
        )
        if held is not None:
            factors = _factorise(frame, held)
            if factors:
                yield factors, _MOST_ITERATIONS

    inverses = offer_inverses()
    inverse, most = next(inverses)
    shape = stencils.n_fields, *stencils.shape

    def apply(vector: Array) -> Array:
        if product is not None:
            return np.ravel(product(vector.reshape(shape), None)[0])
        if held is not None:
            return np.asarray(held @ vector)
        motion = Motion(vector.reshape(shape), 0.0)
        return np.ravel(place.respond(motion, acting)[0]) + _HOLDING * stiff * vector

    def precondition(vector: Array) -> Array:
        return np.ravel(inverse(vector.reshape(shape)))

    def find(pull: Array) -> Array:
        nonlocal inverse, most
        right = np.ravel(pull)
        if symmetric:
            floor = (_NOISE * float(np.max(np.abs(right)))) ** 2 * right.size / stiff
            motion, taken, stable = conjugate_gradients(
                apply, precondition, right, _RESPONSE, most, floor
            )
            done = stable and taken < most
        else:
            # where balls hardly differ, what a strain leaves is rounding of the forces that it
            # makes
            floor = _NOISE * stiff * math.sqrt(right.size)
            stable = True
            motion, done = _solve_by_gmres(apply, precondition, right, floor, most)
            better = None if done else next(inverses, None)
            if better is not None:
                inverse, most = better
                motion, done = _solve_by_gmres(apply, precondition, right, floor, most)
        if not done:
            why = (
                ""
                if stable
                else "The forces push balls aside more than the contacts hold them: it is not"
                " stable"
            )
            raise ConvergenceError(
                "the linear response of the sample is not found", why, "Raise the load"
            )
        return motion.reshape(shape)

    return find


def _solve_by_gmres(
    apply: Map, precondition: Map, right: Array, floor: float, most: int
) -> tuple[Array, bool]:
    # imported here: media that are not simulated do not need it
    from scipy.sparse.linalg import (
        LinearOperator,
        gmres,
    )

    size = right.size, right.size
    found, failed = gmres(
        LinearOperator(size, matvec=apply, dtype=np.float64),
        right,
        rtol=1e-2 * _RESPONSE,
        atol=floor,
        restart=KEPT,
        maxiter=most // KEPT,
        M=LinearOperator(size, matvec=precondition, dtype=np.float64),
    )
    return found, not failed


def find_elastic_tensor(
    place: ExactPlace, acting: ActingForces, stencils: Stencils, springs: Array
) -> Array:
    """Return the (n, n) elastic tensor of an array under stress, in Voigt order, in units of
    stiffness times d^(2 - p).

    It is the change of the Cauchy stress with strain, as
    :meth:`granphon.dynamics.lattice.ContactLattice.elastic_tensor` has it, of which the symmetric
    part is kept. The cell is the compressed one. ``stencils``, ``springs`` and errors are those of
    :func:`find_motions`.
    """
    geometry = place.geometry
    p = len(stencils.shape)
    # deformations of the frames under unit strains: component k of S w is the sum over l of (frame
    # S frame^T)_kl w_l
    frames = geometry.axes()
    pairs = voigt_pairs(p)
    eps = geometry.ratio
    unit = np.zeros((len(pairs), p, p))
    for one, (a, b) in zip(unit, pairs, strict=True):
        one[a, b] += 0.5
        one[b, a] += 0.5
    turned = np.einsum("nka,vab,nlb->vnkl", frames, unit, frames)
    strains = np.zeros((len(pairs), geometry.frame.n_rows // len(place.size), *place.size.shape))
    strains[:, :p] = np.einsum("vnkl,ln...->vkn...", turned, np.array(place.vector[:p]))
    find = find_motions(place, acting, stencils, springs)
    for one in strains:  # what is left of each once the balls have moved
        one -= geometry.deform(
            Motion(find(geometry.frame.forces(*place.resist(one, acting)[0])), 0.0)
        )
    resisted = (place.resist(one, acting)[0] for one in strains)
    tensor = np.array([[np.sum(tensions * one) for one in strains] for tensions in resisted])
    measure = (
        stencils.lattice.measure * math.prod(stencils.shape) * (1.0 - eps * place.overlap) ** p
    )
    tensor = tensor / measure + find_stress_part(
        place.stress(np.abs(acting.forces), acting.shears) / measure
    )
    return np.asarray(0.5 * (tensor + tensor.T))


def _factorise(frame: Stencils, matrix: Any, symmetric: bool = False) -> Inverse | None:
    """Return what finds the motions of balls (fields, L1, ..., Lp) from forces on them, by factors
    of the ``matrix``.

    If that is ``symmetric``, it has to be positive definite too; None is returned if it is not.
    """
    factors = factorise(matrix, symmetric)
    if symmetric and factors.n_below:
        return None

    return lambda force: frame.centre(
        np.asarray(factors.solve(frame.centre(force).ravel())).reshape(force.shape)
    )


def _invert_balls(frame: Stencils, stiffness: float, tables: Iterable[Array]) -> Inverse:
    """Return what moves each ball under a force while its neighbours are held.

    ``tables`` are those of :meth:`~granphon.array.geometry.ExactPlace.tabulate`, for the
    deformations of the ``frame``; ``stiffness`` is the mean one of contacts.
    """
    count, axes = frame.motions.count, range(1, 1 + len(frame.shape))
    head, tail = (
        one.reshape(-1, frame.n_contacts, frame.n_balls, count) for one in frame.coefficients
    )
    blocks = np.zeros((count, count, frame.n_balls, *frame.shape))
    for row, forces in enumerate(tables):
        for kind, (shift, (i, j)) in enumerate(zip(frame.shifts, frame.ends, strict=True)):
            for end, rows, step in (
                (i, tail[:, kind, i], (0,) * len(shift)),
                (j, head[:, kind, j], shift),
            ):
                found = np.roll(np.tensordot(rows, forces[:, kind], (0, 0)), step, axes)
                blocks[:, :, end] += found[:, None] * rows[row].reshape(-1, *(1,) * len(shift))
    by_ball = np.moveaxis(blocks.reshape(count, count, -1), 2, 0)
    inverse = np.linalg.inv(by_ball + _HOLDING * stiffness * np.eye(count))

    def apply(force: Array) -> Array:
        forces = force.reshape(frame.n_balls, count, -1).swapaxes(1, 2).reshape(-1, count, 1)
        return (
            (inverse @ forces).reshape(frame.n_balls, -1, count).swapaxes(1, 2).reshape(force.shape)
        )

    return apply
