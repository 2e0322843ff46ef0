"""Statics of a crystal: the balls and the cell at rest under a load, held by normal forces alone.

The unknowns x are the displacements u of the balls, the strain E of the periods and the way h of a wall that presses. A
contact whose vector from ball to ball is v at touch has the overlap delta, which is linear in x where overlaps are small:

    delta = -n.w,    w = u_j - u_i + E v,    n = v/|v|

The state at rest is the minimum of the energy of all contacts less the work of the load. It is a convex problem, as contacts
push ever harder; the forces at rest are therefore unique, while balls that nothing holds may be anywhere. Newton's method
with a line search finds the minimum. Where contacts have opened, its matrix is short of their stiffness, and a small
stiffness that falls with the residual is added to all contacts. Overlaps are not computed anew from x but carried along,
step by step: so their digits do not depend on how large the displacements of a tall column are.

In the true geometry (finite overlap) contacts turn, delta = -(|v + w| - |v|), and the stress is Cauchy's, on the deformed
cell. Newton's method starts there from the state at small overlap, and its matrix has the term -f/r of turning contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.krylov import conjugate_gradients
from granphon.array.sparse_matrices import factorise
from granphon.balls.contact_laws import PairLaw, opening_overlap
from granphon.base.errors import ConvergenceError, InputError, InstabilityError, message

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: residual, over the mean force, at which a state is at rest, and that which must be reached
_TOLERANCE, _REQUIRED = 2e-15, 1e-12
#: the first of these where the linear equations are solved by iteration
_ITERATED = 3e-13
#: largest number of steps of Newton's method, and of slopes in a line search
_STEPS, _SLOPES = 200, 60
#: stiffness that is added to all contacts, over the mean, for a residual of the size of the mean force
_ADDED = 1e-2
#: stiffness that holds balls which nothing else holds, over the mean
_HOLD = 1e-11
#: the same in a preconditioner: what rounding leaves of motions that cost nothing would grow by its inverse
_HOLD_LOOSELY = 1e-6
#: reach of a line search, in steps, from which on the energy is taken to fall without end
_ENDLESS = 1e7
#: overlap over the largest one, up to which a contact is open: it is the rounding of directions
_ROUNDING = 1e-12
#: most unknowns of matrices that are factorised, on a line, in the plane and in space; and that are so in each step
_MOST_FACTORISED, _MOST_DIRECT = (4_000_000, 1_000_000, 12_000), 2_000
#: most iterations of conjugate gradients with the factors of an earlier step
_PATIENCE = 30
#: mean force, over that before the balls have moved, at which nothing is left of it
_RELAXED = 1e-12
#: what rounding leaves of the forces on a ball, over their size
_ROUNDED = 4e-16
#: most iterations of conjugate gradients in one step
_ITERATIONS = 4000
#: most contacts for which a load that is not borne is explained
_MOST_EXPLAINED = 20_000


class Springs:
    """The laws of all contacts: a law for each group of them, as functions of the overlaps (n_c,)."""

    def __init__(self, groups: Sequence[tuple[PairLaw, Index]], count: int) -> None:
        self.groups, self.count = groups, count
        self.least = np.zeros(count)
        self.most = np.full(count, np.inf)
        self.tension = np.zeros(count)
        for law, contacts in groups:
            self.least[contacts] = least = opening_overlap(law)
            self.most[contacts] = float(getattr(law, "most_overlap", math.inf))
            self.tension[contacts] = math.inf if least == -math.inf else -min(float(np.asarray(law.force(least))), 0.0)

    @property
    def adhesion(self) -> Array:
        """The tension that contacts bear before they open, N; zero of a bond, which has no such scale."""
        return np.where(np.isinf(self.tension), 0.0, self.tension)

    @property
    def adhere(self) -> bool:
        """Whether some contact bears tension."""
        return bool(np.any(self.tension > 0.0))

    def size(self, force: Array) -> float:
        """Return the size of forces by which residuals are measured: the mean of those that are not zero, N.

        It is the tension that contacts can bear, if that is larger; zero if all contacts are open, or at rest as bonds.
        """
        loaded = np.abs(force[force != 0.0])
        return max(float(np.mean(loaded)) if loaded.size else 0.0, float(np.mean(self.adhesion)))

    def _find(self, name: str, values: Array) -> Array:
        out = np.empty(self.count)
        for law, contacts in self.groups:
            out[contacts] = getattr(law, name)(values[contacts])
        return out

    def force(self, overlap: Array) -> Array:
        """Forces, N."""
        return self._find("force", overlap)

    def stiffness(self, overlap: Array) -> Array:
        """Stiffnesses, N/m."""
        return self._find("stiffness", overlap)

    def stiffness_slope(self, overlap: Array) -> Array:
        """Slopes of the stiffnesses, N/m^2."""
        return self._find("stiffness_slope", overlap)

    def energy(self, overlap: Array) -> Array:
        """Energies, J."""
        return self._find("energy", overlap)

    def overlap(self, force: Array) -> Array:
        """Overlaps at forces that contacts can bear, m."""
        return self._find("overlap", force)


@dataclass(frozen=True)
class Frame:
    """The unknowns of a crystal, and its contacts as functions of them.

    Attributes
    ----------
    vector : (n_c, d) from ball i to ball j, or to the wall, at touch, m.
    flat : (n_c,) whether a contact is with a flat wall, which does not turn.
    motion : (n_c d, N) sparse: the vectors w from the unknowns.
    dimension, periods, cell : d, p, and the cell (p, p), m.
    n_free : number of displacements among the unknowns, which come first; then the strains (of ``pairs``), as lengths in
        units of ``length``, then the ways of walls, each of ``walls`` balls.
    """

    vector: Array
    flat: NDArray[np.bool_]
    motion: Any
    dimension: int
    cell: Array
    n_free: int
    pairs: tuple[tuple[int, int], ...]
    walls: tuple[int, ...]
    length: float

    @property
    def periods(self) -> int:
        """Number p of periods."""
        return len(self.cell)

    @property
    def strains(self) -> slice:
        """Which unknowns are strains."""
        return slice(self.n_free, self.n_free + len(self.pairs))

    @cached_property
    def distance(self) -> Array:
        """(n_c,) distance of the centres at touch, m."""
        return np.asarray(np.linalg.norm(self.vector, axis=1))

    @cached_property
    def measure(self) -> float:
        """Length, area or volume of the cell; 1 without a period."""
        return abs(float(np.linalg.det(self.cell))) if self.periods else 1.0

    @cached_property
    def press(self) -> Any:
        """(n_c, N) sparse: overlaps from the unknowns at small overlap."""
        return self.along(self.vector / self.distance[:, None])

    def along(self, normal: Array) -> Any:
        """Return the sparse matrix of overlaps that the unknowns make along unit normals (n_c, d)."""
        from scipy.sparse import csr_array

        n, d = normal.shape
        rows = csr_array((-normal.ravel(), np.arange(n * d), np.arange(0, n * d + 1, d)), shape=(n, n * d))
        return (rows @ self.motion).tocsr()

    def strain(self, x: Array) -> Array:
        """Return the strain E (p, p)."""
        out = np.zeros((self.periods, self.periods))
        for (a, b), value in zip(self.pairs, x[self.strains], strict=True):
            out[a, b] = out[b, a] = value / self.length
        return out

    def work_of(self, stress: Array) -> Array:
        """Return the forces on the strains, of a ``stress`` (p, p) on the cell as it is at touch."""
        return np.array([(1.0 if a == b else 2.0) * stress[a, b] for a, b in self.pairs]) * (self.measure / self.length)

    @cached_property
    def weights(self) -> Array:
        """What makes the residual of each unknown a force on a ball."""
        out = np.ones(self.motion.shape[1])
        out[self.strains] = 1.0 / math.sqrt(len(self.vector))
        out[self.strains.stop :] = 1.0 / np.array(self.walls)
        return out


@dataclass(frozen=True)
class Rest:
    """A state at rest: unknowns x (N,), overlaps (n_c,), and the unit normals of the contacts."""

    x: Array
    overlap: Array
    normal: Array
    residual: float = 0.0


@dataclass(frozen=True)
class Push:
    """A load: forces (N,) on the unknowns, and which of these (N,) have a given value, in ``given`` (N,).

    ``stress`` (p, p) is that of the periods, in the true geometry; ``pressed`` are the forces that grow with the area of the
    cell. ``words`` is what messages call the load, and ``lifted`` (why, mend) what they say if gravity acts away from what
    the crystal stands on.
    """

    force: Array
    held: NDArray[np.bool_]
    given: Array
    stress: Array | None
    pressed: Array
    words: str
    lifted: tuple[str, str] | None = None


def typical_force(frame: Frame, push: Push, springs: Springs) -> float:
    """Return the size of contact forces under a load, N, to begin with."""
    virial = float(np.sum(frame.distance))
    if push.stress is not None and frame.periods and (pull := float(np.trace(push.stress))) < 0.0:
        return -pull * frame.measure / virial
    if push.stress is not None and np.any(push.stress) and np.any(np.isinf(springs.tension)):  # bonds pull as well
        return float(np.linalg.norm(push.stress)) * frame.measure / virial
    sizes = np.abs(push.force[: frame.n_free])
    largest = max(float(np.sum(sizes)) / max(len(frame.vector) ** 0.5, 1.0), float(np.max(sizes, initial=0.0)))
    walls = np.abs(push.force[frame.strains.stop :]) / np.array(frame.walls)
    largest = max(largest, float(np.max(walls, initial=0.0)))
    return largest or float(np.max(springs.adhesion))


def settle(frame: Frame, springs: Springs, push: Push, start: Rest | None = None) -> Rest:
    """Find the state at rest at small overlap.

    Raises :class:`~granphon.base.errors.InputError` if the load cannot be borne by contacts that push (or adhere), and
    :class:`~granphon.base.errors.ConvergenceError` if Newton's method does not come to rest.
    """
    press = frame.press
    x = np.zeros(press.shape[1])
    x[push.held] = push.given[push.held]
    overlap = np.asarray(press @ x)
    system = _System(frame, press, push.held)
    if start is not None:
        x, overlap = start.x.copy(), start.overlap.copy()
        x[push.held] = push.given[push.held]
    elif not np.any(push.given):
        # the first guess is that of linear springs, whose law is that of the contacts at a typical force
        size = np.full(len(overlap), typical_force(frame, push, springs))
        if not np.any(size):
            if np.any(push.force):
                raise _explain(frame, springs, push)
            if np.any(springs.stiffness(overlap) > 0.0):  # bonds
                return Rest(x, overlap, frame.vector / frame.distance[:, None])
            raise InputError(message(f"{push.words} presses nothing", "Contacts have no stiffness without a force"))
        with np.errstate(all="ignore"):
            while not np.all(np.isfinite(at := springs.overlap(size))) and size[0] > 1e-300:
                size = 0.5 * size  # a law may have a largest force
        stiffness = springs.stiffness(at)
        x = system.solve(stiffness, push.force - press.T @ (size - stiffness * at), 1e-3, float(size[0]))
        overlap = np.asarray(press @ x)
    x, overlap, residual = _descend(frame, springs, push, system, x, overlap)
    if not springs.adhere or np.any(np.isinf(springs.tension)):
        rounded = (np.abs(overlap) <= _ROUNDING * np.max(np.abs(overlap))) & (springs.tension == 0.0)
        overlap = np.where(rounded, 0.0, overlap)
    return Rest(x, overlap, frame.vector / frame.distance[:, None], residual)


def _descend(
    frame: Frame, springs: Springs, push: Push, system: _System, x: Array, overlap: Array
) -> tuple[Array, Array, float]:
    """Newton's method on the energy at small overlap: return unknowns, overlaps and the residual."""
    press, free = frame.press, ~push.held
    best, stalled, kept, first = math.inf, 0, (x, overlap), 0.0
    for _ in range(_STEPS):
        force = springs.force(overlap)
        mean = springs.size(force)
        first = first or mean
        # under a strain alone balls may move aside until none is pressed
        if not mean or (mean < _RELAXED * first and not np.any(push.force)):
            raise _explain(frame, springs, push, opened=True)
        pull = np.where(free, push.force - press.T @ force, 0.0)
        residual = float(np.max(np.abs(pull) * frame.weights, initial=0.0)) / mean
        if residual <= (_TOLERANCE if system.direct else _ITERATED):
            return x, overlap, residual
        stalled = stalled + 1 if residual > 0.5 * best else 0
        if residual < best:
            best, kept = residual, (x, overlap)
        if best <= _REQUIRED and stalled > 2:
            break
        stiffness = springs.stiffness(overlap)
        closed = stiffness[stiffness > 0.0]
        added = _ADDED * min(1.0, residual) * float(np.mean(closed)) if closed.size else mean / frame.length
        step = system.solve(stiffness + added, pull, min(0.1, max(0.1 * residual**0.5, 1e-4)), mean)
        change = np.asarray(press @ step)
        length = _find_length(springs, overlap, change, force, float(pull @ step), residual)
        if length is None:
            raise _explain(frame, springs, push)
        x, overlap = x + length * step, overlap + length * change
    if best > _REQUIRED:
        error = _explain(frame, springs, push, residual=best)
        if springs.adhere and isinstance(error, ConvergenceError):
            at = int(np.argmin(overlap - springs.least))
            why = f"It bears a tension of up to {springs.tension[at]:.6g} N"
            error = InputError(message(f"{push.words} pulls contact {at} apart", why, "Press the crystal more"))
        raise error
    return *kept, best


def _find_length(
    springs: Springs, overlap: Array, change: Array, force: Array, fall: float, residual: float
) -> float | None:
    """Return the length of a step at which the energy no longer falls much; None if it falls without end.

    ``fall`` is the work that the step does, per length, at its beginning.
    """
    most = math.inf
    if springs.adhere:  # no contact may be torn on the way
        apart = change < 0.0
        room = (overlap - springs.least)[apart] / -change[apart]
        most = max(0.9 * float(np.min(room, initial=math.inf)), 1e-9)

    def slope(length: float) -> float:
        return float((springs.force(overlap + length * change) - force) @ change) - fall

    length, low, high = min(1.0, most), 0.0, math.inf
    if fall <= 0.0:  # the rounding of a state at rest
        return length
    for _ in range(_SLOPES):
        here = slope(length)
        if abs(here) <= 0.1 * fall or (residual < 1e-6 and length == 1.0 and here <= fall):
            return length
        if here < 0.0:
            low = length
            if length >= most:
                return length
            if length > _ENDLESS:
                return None
        else:
            high = length
        length = min(4.0 * length, most) if high == math.inf else 0.5 * (low + high)
    return length


class _System:
    """The linear equations of Newton's method: B^T K B x = b, of the unknowns that are free.

    Few unknowns are found from LU factors. More are found by conjugate gradients, whose preconditioner is the LU factors of
    an earlier step where these are not too large, which they are in space, and the blocks of the balls elsewhere.
    """

    def __init__(self, frame: Frame, press: Any, held: NDArray[np.bool_]) -> None:
        self.frame, self.free = frame, np.flatnonzero(~held)
        self.renew(press)
        self.direct = frame.dimension == 1 or len(self.free) <= _MOST_DIRECT
        self.factored = len(self.free) <= _MOST_FACTORISED[frame.dimension - 1]
        self.inverse: Callable[[Array], Array] | None = None

    def renew(self, press: Any) -> None:
        """Take other overlaps (n_c, N) of the unknowns."""
        self.press = press if len(self.free) == press.shape[1] else press[:, self.free]
        self.transposed = self.press.T.tocsr()

    def solve(self, stiffness: Array, right: Array, reduction: float, size: float) -> Array:
        """Return the unknowns (N,) at which springs of ``stiffness`` (n_c,) balance the forces ``right`` (N,).

        Iterations end when the rest has fallen by ``reduction``, or is what rounding leaves of forces of a ``size``.
        """
        out = np.zeros(len(right))
        if not len(self.free):
            return out
        scale = float(np.mean(stiffness))
        springs, aim = stiffness / scale, right[self.free] / scale
        if self.direct:
            out[self.free] = factorise(self._matrix(self.press, springs, _HOLD)).solve(aim)
            return out

        def apply(vector: Array) -> Array:
            return np.asarray(self.transposed @ (springs * (self.press @ vector)))

        floor = len(self.free) * (_ROUNDED * size / scale) ** 2
        most = _PATIENCE if self.factored else _ITERATIONS
        for _ in range(2):
            fresh = self.inverse is None
            if fresh:
                self.inverse = self._invert(springs)
            assert self.inverse is not None
            found, count, fine = conjugate_gradients(apply, self.inverse, aim, reduction, most, floor, True)
            if fresh or (count < most and fine):
                break
            self.inverse = None
        out[self.free] = found
        return out

    @staticmethod
    def _matrix(press: Any, stiffness: Array, hold: float) -> Any:
        """Return B^T K B, with springs that hold each unknown."""
        from scipy.sparse import diags_array, eye_array

        return (press.T @ (diags_array(stiffness) @ press) + hold * eye_array(press.shape[1])).tocsc()

    def _invert(self, stiffness: Array) -> Callable[[Array], Array]:
        """Return an approximate inverse of B^T K B, from LU factors of the displacements, or the blocks of the balls.

        Strains and walls, which act on all balls, would fill the factors: they have their own diagonal.
        """
        d, n = self.frame.dimension, int(np.count_nonzero(self.free < self.frame.n_free))
        squares = self.transposed[n:].multiply(self.transposed[n:])
        diagonal = np.asarray(squares @ stiffness) + _HOLD
        if self.factored:
            matrix = self._matrix(self.press[:, :n], stiffness, _HOLD_LOOSELY)
            factors = factorise(matrix, approximate=True)

            def solve(force: Array) -> Array:
                largest = float(np.max(np.abs(force), initial=0.0)) or 1.0  # single precision has no numbers below 1e-38
                return np.asarray(factors.solve((force / largest).astype(np.float32)) * largest, float)

        else:
            blocks = self._find_blocks(stiffness, n)

            def solve(force: Array) -> Array:
                return np.asarray(np.einsum("nab,nb->na", blocks, force.reshape(-1, d)).ravel())

        return lambda vector: np.concatenate([solve(vector[:n]), vector[n:] / diagonal])

    def _find_blocks(self, stiffness: Array, n: int) -> Array:
        """Return the inverse blocks (balls, d, d) of the ``n`` displacements."""
        d = self.frame.dimension
        coo = self.press[:, :n].tocoo()
        ball, axis = np.divmod(coo.col, d)
        blocks = np.zeros((n // d, d, d))
        # the entries of a contact at a ball are its normal: -n or n
        key = coo.row * np.int64(n // d) + ball
        order = np.argsort(key, kind="stable")
        full = np.zeros((len(np.unique(key)), d))
        _, slot = np.unique(key, return_inverse=True)
        full[slot, axis] = coo.data
        first = order[np.searchsorted(key[order], np.unique(key))]
        weight, owner = stiffness[coo.row[first]], ball[first]
        for a in range(d):
            for b in range(d):
                blocks[:, a, b] = np.bincount(owner, weight * full[:, a] * full[:, b], n // d)
        mean = float(np.mean(np.trace(blocks, axis1=1, axis2=2)))
        return np.asarray(np.linalg.inv(blocks + 1e-6 * mean * np.eye(d)), float)


# -- in the true geometry ---------------------------------------------------------------------------------------------------


def settle_exactly(frame: Frame, springs: Springs, push: Push, start: Rest) -> Rest:
    """Find the state at rest where contacts turn and the cell deforms, from that at small overlap.

    Raises :class:`~granphon.base.errors.InstabilityError` if there is none near it.
    """
    from scipy.sparse import coo_array

    if not (np.any(start.overlap) or np.any(push.force)):
        return start  # bonds without a load
    x, d, v = start.x.copy(), frame.dimension, frame.vector
    n_c, p, free = len(v), frame.periods, ~push.held
    best, stalled, kept = math.inf, 0, start
    row, column = (
        np.repeat(np.arange(n_c * d).reshape(n_c, d, 1), d, 2),
        np.tile(np.arange(n_c * d).reshape(n_c, 1, d), (1, d, 1)),
    )
    system = _System(frame, frame.press, push.held)
    for _ in range(_STEPS):
        w = np.asarray(frame.motion @ x).reshape(n_c, d)
        now = v + w
        r = np.where(frame.flat, np.inf, np.linalg.norm(now, axis=1))
        normal = np.where(frame.flat[:, None], v / frame.distance[:, None], now / r[:, None])
        stretch = np.einsum("ca,ca->c", 2.0 * v + w, w) / (r + frame.distance)
        overlap = -np.where(frame.flat, np.einsum("ca,ca->c", normal, w), stretch)
        overlap = np.where(np.abs(overlap) <= _ROUNDING * np.max(np.abs(overlap)), 0.0, overlap)
        force = springs.force(overlap)
        mean = springs.size(force)
        if not (mean and np.all(np.isfinite(x)) and np.all(r > 0.0)):
            break
        deformed = np.eye(p) + frame.strain(x)
        if p and np.min(np.linalg.eigvalsh(deformed)) <= 0.0:
            break  # the cell is inside out
        area = float(np.linalg.det(deformed)) if p else 1.0
        wanted = push.force + (area - 1.0) * push.pressed
        if push.stress is not None and p:
            work = push.stress @ np.linalg.inv(deformed) * area
            wanted[frame.strains] = frame.work_of(0.5 * (work + work.T))
        press = frame.along(normal)
        pull = np.where(free, wanted - press.T @ force, 0.0)
        residual = float(np.max(np.abs(pull) * frame.weights, initial=0.0)) / mean
        stalled = stalled + 1 if residual > 0.5 * best else 0
        if residual < best:
            best, kept = residual, Rest(x, overlap, normal, residual)
        if residual <= (_TOLERANCE if system.direct else _ITERATED) or (best <= _REQUIRED and stalled > 2):
            return kept
        if stalled > 20:
            break
        stiffness = springs.stiffness(overlap)
        if not np.any(stiffness):
            break
        if system.factored:
            across = force / r
            block = (stiffness + across)[:, None, None] * normal[:, :, None] * normal[:, None, :]
            block -= across[:, None, None] * np.eye(d)
            middle = coo_array((block.ravel(), (row.ravel(), column.ravel())), shape=(n_c * d, n_c * d)).tocsr()
            matrix = frame.motion.T @ (middle @ frame.motion) - _follow(frame, push, deformed, area)
            x = x + _solve_indefinite(matrix, system.free, pull, float(np.mean(stiffness)))
        else:
            system.renew(press)
            x = x + system.solve(stiffness, pull, 1e-4, mean)
    why = "Its contacts turn away under the load, and nothing holds it"
    raise InstabilityError(message(f"the crystal collapses under {push.words}", why, "Lower the load, or add contacts"))


def _follow(frame: Frame, push: Push, deformed: Array, area: float) -> Any:
    """Return the sparse derivative of the load by the unknowns: it follows the cell as that deforms."""
    from scipy.sparse import coo_array

    size, inverse = frame.motion.shape[1], np.linalg.inv(deformed)
    columns = np.zeros((size, len(frame.pairs)))
    for number, (a, b) in enumerate(frame.pairs):
        change = np.zeros_like(deformed)
        change[a, b] = change[b, a] = 1.0 / frame.length
        grown = area * float(np.trace(inverse @ change))
        columns[:, number] = grown * push.pressed
        if push.stress is not None:
            work = push.stress @ (grown * inverse - area * inverse @ change @ inverse)
            columns[frame.strains, number] = frame.work_of(0.5 * (work + work.T))
    row, column = np.nonzero(columns)
    return coo_array((columns[row, column], (row, frame.n_free + column)), shape=(size, size)).tocsr()


def _solve_indefinite(matrix: Any, free: Index, right: Array, scale: float) -> Array:
    from scipy.sparse import eye_array

    out = np.zeros(len(right))
    if len(free):
        own = (matrix.tocsr()[free][:, free] / scale + _HOLD * eye_array(len(free))).tocsc()
        out[free] = factorise(own, pivot=0.01).solve(right[free]) / scale
    return out


# -- what cannot be ---------------------------------------------------------------------------------------------------------


def _explain(
    frame: Frame, springs: Springs, push: Push, opened: bool = False, residual: float | None = None
) -> InputError | ConvergenceError:
    """Return the error of a load that the crystal has not come to rest under."""
    free = ~push.held
    why = mend = ""
    borne = True
    if len(frame.vector) <= _MOST_EXPLAINED:
        from scipy.optimize import linprog

        press = frame.press[:, np.flatnonzero(free)].T
        size = float(np.max(np.abs(push.force))) or 1.0
        right = push.force[free] / size
        least = -springs.tension / size

        def search(columns: Any, cost: Array) -> Any:
            bounds = [(one, None) for one in [*least.tolist(), *[0.0] * (columns.shape[1] - len(least))]]
            return linprog(cost, A_eq=columns, b_eq=right, bounds=bounds, method="highs")

        borne = search(press, np.zeros(press.shape[1])).status == 0
        if not borne and frame.periods and not np.any(push.held):
            from scipy.sparse import csr_array, hstack

            sides = np.zeros(len(push.force))
            sides[frame.strains] = frame.work_of(np.eye(frame.periods)) / frame.measure
            cost = np.zeros(press.shape[1] + 1)
            cost[-1] = 1.0
            found = search(hstack([press, csr_array(sides[free][:, None] * 1.0)]), cost)
            if found.status == 0:
                needed = found.x[-1] * size / frame.measure
                unit = ("N", "N/m", "Pa")[frame.periods - 1]
                presses = np.max(np.abs(found.x[:-1])) > 1e-9 * found.x[-1]  # or else it only takes the load off
                mend = f"A pressure {'of' if presses else 'above'} {needed:.4g} {unit} from all sides in addition would do"
    if not borne:
        what = f"the crystal cannot bear {push.words}"
        why = "Contacts only push along the lines of their centres, and no such forces add up to it"
        if springs.adhere:
            why = "No forces along the lines of the centres, up to the tension that contacts bear, add up to it"
        mend = mend or "Press the crystal from the sides too, or give another load"
        return InputError(message(what, *(push.lifted or (why, mend))))
    if opened:
        return InputError(
            message(f"all contacts are open under {push.words}", "Balls that do not touch have no stiffness", "Press them")
        )
    size = typical_force(frame, push, springs)
    with np.errstate(all="ignore"):
        reached = np.all(np.isfinite(springs.overlap(np.full(springs.count, size))))
    if not reached:
        why = f"They are about {size:.4g} N, and the law has no overlap at that force"
        mend = "Lower the load, or give a law whose force grows on"
        return InputError(message(f"a contact law does not reach the forces under {push.words}", why, mend))
    left = "" if residual is None else f"A force of {residual:.2g} of the mean is left on a ball"
    return ConvergenceError(message(f"the crystal has not come to rest under {push.words}", left))
