"""Statics of a crystal: the balls and the cell at rest under a load, held by normal forces alone.

The unknowns x are the displacements u of the balls, the strain E of the periods and the way h of a
wall that presses. A contact whose vector from ball to ball is v at touch has the overlap delta,
which is linear in x where overlaps are small:

    delta = o - n.w,    w = u_j - u_i + E v,    n = v/|v|

with the overlap o of the balls on their sites, zero but where their radii differ from those of the
mean balls that touch.

The state at rest is the minimum of the energy of all contacts less the work of the load. It is a
convex problem, as contacts push ever harder; the forces at rest are therefore unique, while balls
that nothing holds may be anywhere. Newton's method with a line search finds the minimum. Where
contacts have opened, its matrix is short of their stiffness, and a small stiffness that falls with
the residual is added to all contacts. Overlaps are not computed anew from x but carried along, step
by step: so their digits do not depend on how large the displacements of a tall column are.

In the true geometry (finite overlap) contacts turn, delta = o - (|v + w| - |v|), and the stress is
Cauchy's, on the deformed cell. Newton's method starts there from the state at small overlap, and
its matrix has the term -f/r of turning contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from granphon.array.equilibrium import CARRIED_FORCE
from granphon.array.krylov import conjugate_gradients
from granphon.balls.contact_laws import PairLaw, opening_overlap, punch_stiffness, touching_overlap
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS, EnergyLaw
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import ConvergenceError, InputError, InstabilityError, MechanismError
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import find_nearest

#: residual, over the mean force, at which a state is at rest, and that which must be reached
_TOLERANCE = 2e-15
_REQUIRED = 1e-12
#: the first of these where the linear equations are solved by iteration
_ITERATED = 3e-13
#: largest number of steps of Newton's method, and of slopes in a line search
_STEPS = 200
_SLOPES = 60
#: steps in the true geometry without half of the residual, after which balls that differ move
#: together, and four times as many
_PATIENT = 20
#: most saddles of the energy on the way, and doublings of the displacement with which the way down
#: from one begins
_SADDLES = 50
_DOUBLINGS = 6
#: steps of loose balls while the others are held, and trials of their lengths
_LOOSE_STEPS = 100
_LENGTHS = 12
#: force of a contact, over the mean, up to which it is light: balls with no more heavy ones than
#: dimensions are loose
_LIGHT = 1e-3
#: force that may be left on a loose ball, over the mean, in units of the spread or of what is left
#: on others
_OF_LOOSE = 1e-3
#: force left on a ball after a step, over the most before it, from which the ball counts as loose
#: too
_FAILED = 0.3
#: force left on a ball after a whole step of Newton's method, over the mean, from which the step is
#: not taken
_TOO_FAR = 1e2
#: what mends a crystal of differing balls that falls
_STAY = "Leave finite_overlap out: contacts then keep the directions of the sites"
#: stiffness of a motion, over that of a contact, up to which it costs no energy
_SOFT = 1e-9
#: curvature below zero, over what forces could make, that is not rounding
_DOWN = 1e-6
#: stiffness that is added to all contacts, over the mean, for a residual of the size of the mean
#: force
_ADDED = 1e-2
#: stiffness that holds balls which nothing else holds, over the mean
_HOLD = 1e-11
#: the same in a preconditioner: what rounding leaves of motions that cost nothing would grow by its
#: inverse
_HOLD_LOOSELY = 1e-6
#: reach of a line search, in steps, from which on the energy is taken to fall without end
_ENDLESS = 1e7
#: overlap over the largest one, up to which a contact is open: it is the rounding of directions
_ROUNDING = 1e-12
#: most unknowns of matrices that are factorised, on a line, in the plane and in space; and that are
#: so in each step
_MOST_FACTORISED = (4_000_000, 1_000_000, 12_000)
_MOST_DIRECT = 2_000
#: most iterations of conjugate gradients with the factors of an earlier step
_PATIENCE = 30
#: mean force, over that before the balls have moved, at which nothing is left of it
_RELAXED = 1e-12
#: what rounding leaves of the forces on a ball, over their size
_ROUNDED = 4e-16
#: most iterations of conjugate gradients in one step
_ITERATIONS = 4000
#: factors by which stiffnesses of contacts, and forces of a load, may differ where a crystal does
#: not come to rest
_MOST_STIFF = 1e10
_MOST_FORCES = 1e6
#: most contacts for which a load that is not borne is explained
_MOST_EXPLAINED = 20_000


class Springs:
    """The laws of contacts: a law for each group of them, as functions of the overlaps (n_c,);
    others never push.

    ``modulus`` (n_c,) is E* of their bodies, Pa, where a law knows the radius of its contacts.
    """

    def __init__(
        self, groups: Sequence[tuple[PairLaw, Index]], count: int, modulus: Array | None = None
    ) -> None:
        self.groups = groups
        self.count = count
        self.modulus = np.ones(count) if modulus is None else modulus
        self.least = np.zeros(count)
        self.touch = np.zeros(count)
        self.most = np.full(count, np.inf)
        self.tension = np.zeros(count)
        for law, contacts in groups:
            self.least[contacts] = least = opening_overlap(law)
            self.touch[contacts] = touching_overlap(law)
            self.most[contacts] = float(getattr(law, "most_overlap", math.inf))
            # a law may be zero at the end itself
            last = (
                np.asarray(law.force(np.array([least, math.nextafter(least, math.inf)])))
                if least > -math.inf
                else -np.inf
            )
            self.tension[contacts] = -min(float(np.min(last)), 0.0)

    @property
    def adhesion(self) -> Array:
        """The tension that contacts bear before they open, N; zero of a bond, which has no such
        scale.
        """
        return np.where(np.isinf(self.tension), 0.0, self.tension)

    @property
    def adhere(self) -> bool:
        """Whether some contact bears tension."""
        return bool(np.any(self.tension > 0.0))

    def size(self, force: Array) -> float:
        """Return the size of forces by which residuals are measured: the mean of those that are not
        zero, N.

        It is the tension that contacts can bear, if that is larger; zero if all contacts are open,
        or at rest as bonds.
        """
        loaded = np.abs(force[force != 0.0])
        return max(float(np.mean(loaded)) if loaded.size else 0.0, float(np.mean(self.adhesion)))

    def among(self, contacts: Index) -> Springs:
        """Return the laws of some of the contacts, in their order."""
        place = np.full(self.count, -1)
        place[contacts] = np.arange(len(contacts))
        groups = [(law, own[own >= 0]) for law, at in self.groups for own in (place[at],)]
        return Springs(groups, len(contacts), self.modulus[contacts])

    def force(self, overlap: Array) -> Array:
        """Return the force of each contact, N, at overlaps (n_c,), m."""
        return self._evaluate(overlap, FORCE)

    def stiffness(self, overlap: Array) -> Array:
        """Return the stiffness of each contact, N/m, at overlaps (n_c,), m."""
        return self._evaluate(overlap, STIFFNESS)

    def stiffness_slope(self, overlap: Array) -> Array:
        """Return the slope of the stiffness of each contact, N/m^2, at overlaps (n_c,), m."""
        return self._evaluate(overlap, SLOPE)

    def energy(self, overlap: Array) -> Array:
        """Return the energy of each contact, J, at overlaps (n_c,), m."""
        return self._evaluate(overlap, ENERGY)

    def _evaluate(self, overlap: Array, order: int) -> Array:
        """Return a quantity of all contacts, each by its law.

        Trials of a solver may leave the floating range, which the solver notices: laws of granphon
        are evaluated without checks.
        """
        values = np.zeros(self.count)
        for law, contacts in self.groups:
            if isinstance(law, EnergyLaw):
                values[contacts] = law._evaluate(overlap[contacts], order)
            else:
                find = {
                    ENERGY: law.energy,
                    FORCE: law.force,
                    STIFFNESS: law.stiffness,
                    SLOPE: law.stiffness_slope,
                }[order]
                values[contacts] = find(overlap[contacts])
        return values

    def overlap(self, forces: Array) -> Array:
        """Overlaps at forces that contacts can bear, m."""
        out = np.zeros(self.count)
        for law, contacts in self.groups:
            out[contacts] = law.overlap(forces[contacts])
        return out

    @property
    def know_radii(self) -> bool:
        """Whether some law knows the radius of its contacts."""
        return any(callable(getattr(law, "contact_radius", None)) for law, _ in self.groups)

    def punch(self, overlap: Array) -> Array:
        """Stiffnesses 2 E* a of flat punches as wide as the contacts, N/m."""
        out = np.zeros(self.count)
        for law, contacts in self.groups:
            out[contacts] = punch_stiffness(law, overlap[contacts], self.modulus[contacts])
        return out


@dataclass(frozen=True)
class Frame:
    """The unknowns of a crystal, and its contacts as functions of them.

    Attributes
    ----------
    vector : (n_c, d) from ball i to ball j, or to the wall, at touch, m.
    flat : (n_c,) whether a contact is with a flat wall, which does not turn.
    motion : (n_c d, N) sparse: the vectors w from the unknowns.
    dimension, periods, cell : d, p, and the cell (p, p), m.
    n_free : number of displacements among the unknowns, which come first; then the strains (of
        ``pairs``), as lengths in units of ``length``, then the ways of walls, each of ``walls``
        balls.
    offset : (n_c,) overlaps on the sites, where x = 0, m.
    """

    vector: Array
    flat: Flags
    motion: Any
    dimension: int
    cell: Array
    n_free: int
    pairs: tuple[tuple[int, int], ...]
    walls: tuple[int, ...]
    length: float
    offset: Array

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
        """Return the sparse matrix of overlaps that the unknowns make along unit normals (n_c,
        d).
        """
        from scipy.sparse import csr_array

        n, d = normal.shape
        rows = csr_array(
            (-normal.ravel(), np.arange(n * d), np.arange(0, n * d + 1, d)), shape=(n, n * d)
        )
        return (rows @ self.motion).tocsr()

    def strain(self, x: Array) -> Array:
        """Return the strain E (p, p)."""
        out = np.zeros((self.periods, self.periods))
        for (a, b), value in zip(self.pairs, x[self.strains], strict=True):
            out[a, b] = out[b, a] = value / self.length
        return out

    def work_of(self, stress: Array) -> Array:
        """Return the forces on the strains, of a ``stress`` (p, p) on the cell as it is at
        touch.
        """
        return np.array([(1.0 if a == b else 2.0) * stress[a, b] for a, b in self.pairs]) * (
            self.measure / self.length
        )

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
    """A load: forces (N,) on the unknowns, and which of these (N,) have a given value, in ``given``
    (N,).

    ``stress`` (p, p) is that of the periods, in the true geometry; ``pressed`` are the forces that
    grow with the area of the cell. ``words`` is what messages call the load, and ``lifted`` (why,
    mend) what they say if gravity acts away from what the crystal stands on.
    """

    force: Array
    held: Flags
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
    if push.stress is not None and np.any(push.stress) and np.any(np.isinf(springs.tension)):
        # bonds pull as well
        return float(np.linalg.norm(push.stress)) * frame.measure / virial
    sizes = np.abs(push.force[: frame.n_free])
    largest = max(
        float(np.sum(sizes)) / max(len(frame.vector) ** 0.5, 1.0), float(np.max(sizes, initial=0.0))
    )
    walls = np.abs(push.force[frame.strains.stop :]) / np.array(frame.walls)
    largest = max(largest, float(np.max(walls, initial=0.0)))
    return largest or float(np.max(springs.adhesion))


def settle(frame: Frame, springs: Springs, push: Push, start: Rest | None = None) -> Rest:
    """Find the state at rest at small overlap.

    Raises :class:`~granphon.base.errors.InputError` if the load cannot be borne by contacts that
    push (or adhere), and
    :class:`~granphon.base.errors.ConvergenceError` if Newton's method does not come to rest.
    """
    press = frame.press
    x = np.zeros(press.shape[1])
    x[push.held] = push.given[push.held]
    overlap = frame.offset + np.asarray(press @ x)
    system = _System(frame, press, push.held)
    if start is not None:
        x = start.x.copy()
        overlap = start.overlap.copy()
        x[push.held] = push.given[push.held]
    elif not np.any(push.given):
        # the first guess is that of linear springs, whose law is that of the contacts at a typical
        # force
        size = np.full(len(overlap), typical_force(frame, push, springs))
        if not np.any(size):
            if np.any(push.force):
                raise _explain(frame, springs, push)
            if np.any(springs.stiffness(overlap) > 0.0):  # bonds
                return Rest(x, overlap, frame.vector / frame.distance[:, None])
            raise InputError(
                f"{push.words} presses nothing", "Contacts have no stiffness without a force"
            )
        with np.errstate(all="ignore"):
            while not np.all(np.isfinite(reached := springs.overlap(size))) and size[0] > 1e-300:
                size = 0.5 * size  # a law may have a largest force
        stiffness = springs.stiffness(reached)
        left = push.force - press.T @ (size + stiffness * (frame.offset - reached))
        x = system.solve(stiffness, left, 1e-3, float(size[0]))
        overlap = frame.offset + np.asarray(press @ x)
    # Newton's method on the energy
    free = ~push.held
    best = math.inf
    stalled = 0
    kept = (x, overlap)
    first = 0.0
    for _ in range(_STEPS):
        force = springs.force(overlap)
        mean = springs.size(force)
        first = first or mean
        # under a strain alone balls may move aside until none is pressed
        if not mean or (mean < _RELAXED * first and not np.any(push.force)):
            raise _explain(frame, springs, push, opened=True)
        pull = np.where(free, push.force - press.T @ force, 0.0)
        residual = float(np.max(np.abs(pull) * frame.weights, initial=0.0)) / mean
        stalled = stalled + 1 if residual > 0.5 * best else 0
        if residual < best:
            best = residual
            kept = (x, overlap)
        if residual <= (_TOLERANCE if system.direct else _ITERATED) or (
            best <= _REQUIRED and stalled > 2
        ):
            break
        stiffness = springs.stiffness(overlap)
        closed = stiffness[stiffness > 0.0]
        added = (
            _ADDED * min(1.0, residual) * float(np.mean(closed))
            if closed.size
            else mean / frame.length
        )
        step = system.solve(stiffness + added, pull, min(0.1, max(0.1 * residual**0.5, 1e-4)), mean)
        change = np.asarray(press @ step)
        length = _find_length(springs, overlap, change, force, float(pull @ step), residual)
        if length is None:
            raise _explain(frame, springs, push)
        x = x + length * step
        overlap = overlap + length * change
    if best > _REQUIRED:
        error = _explain(frame, springs, push, residual=best)
        if springs.adhere and isinstance(error, ConvergenceError):
            at = int(np.argmin(overlap - springs.least))
            why = f"It bears a tension of up to {springs.tension[at]:.6g} N"
            error = InputError(
                f"{push.words} pulls contact {at} apart", why, "Press the crystal more"
            )
        raise error
    x, overlap = kept
    if not springs.adhere or np.any(np.isinf(springs.tension)):
        rounded = (np.abs(overlap) <= _ROUNDING * np.max(np.abs(overlap))) & (
            springs.tension == 0.0
        )
        overlap = np.where(rounded, 0.0, overlap)
    rest = Rest(x, overlap, frame.vector / frame.distance[:, None], best)
    return (
        replace(rest, overlap=_open_light(springs, rest))
        if np.any(frame.offset) and not springs.adhere
        else rest
    )


def _find_length(
    springs: Springs, overlap: Array, change: Array, force: Array, fall: float, residual: float
) -> float | None:
    """Return the length of a step at which the energy no longer falls much, at first by ``fall``;
    None if without end.
    """
    most = math.inf
    if springs.adhere:  # no contact may be torn on the way
        apart = change < 0.0
        room = (overlap - springs.least)[apart] / -change[apart]
        most = max(0.9 * float(np.min(room, initial=math.inf)), 1e-9)

    length = min(1.0, most)
    low = 0.0
    high = math.inf
    if fall <= 0.0:  # the rounding of a state at rest
        return length
    for _ in range(_SLOPES):
        there = springs.force(overlap + length * change)
        here = float((there - force) @ change) - fall
        if not np.any(there) and np.any(force):
            # under a load that is small against the forces before it
            here = math.inf
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

    Few unknowns are found from LU factors. More are found by conjugate gradients, whose
    preconditioner is the LU factors of an earlier step where these are not too large, which they
    are in space, and the blocks of the balls elsewhere.
    """

    def __init__(self, frame: Frame, press: Any, held: Flags) -> None:
        self.frame = frame
        self.free = np.flatnonzero(~held)
        self.renew(press)
        self.direct = frame.dimension == 1 or len(self.free) <= _MOST_DIRECT
        self.factored = len(self.free) <= _MOST_FACTORISED[frame.dimension - 1]
        self.inverse: Callable[[Array], Array] | None = None
        d, n = frame.dimension, int(np.count_nonzero(self.free < frame.n_free))
        #: displacements of the whole that no wall hinders: iterations would let them grow from
        #: rounding
        self.drifts = [slice(axis, n, d) for axis in range(d) if 0 < n == frame.n_free]
        self.drifts = [
            one
            for one in self.drifts
            if not np.any(np.abs(self.press[:, one].sum(axis=1)) > _ROUNDING)
        ]

    @property
    def is_floppy(self) -> bool:
        """Whether motions cost no energy while all contacts touch, beside those of the whole; False
        where not probed.
        """
        from scipy.sparse import eye_array

        frame = self.frame
        d = self.frame.dimension
        # of balls with no more contacts than dimensions: they are loose
        few = np.zeros(frame.motion.shape[1], bool)
        few[: frame.n_free] = np.repeat(
            np.diff((frame.motion[:, : frame.n_free : d] != 0).tocsc().indptr) <= d, d
        )
        press = self.press[:, ~few[self.free]]
        size = press.shape[1]
        still = len(self.drifts) + (d - frame.periods) * (d - frame.periods - 1) // 2
        if not self.factored or size <= still + 1:
            return False
        matrix = self._matrix(press, np.ones(press.shape[0]), 0.0)
        solve = factorise(matrix + _SOFT * eye_array(size)).solve
        least, _ = find_nearest(matrix, still + 1, -_SOFT, solve)
        return bool(np.max(least) < _SOFT)

    def _stay(self, vector: Array) -> Array:
        """Return unknowns, or forces on them, without the mean along the axes on which the whole
        may drift.
        """
        out = vector.copy()
        for one in self.drifts:
            out[one] -= np.mean(out[one])
        return out

    def renew(self, press: Any) -> None:
        """Take other overlaps (n_c, N) of the unknowns."""
        self.press = press if len(self.free) == press.shape[1] else press[:, self.free]
        self.transposed = self.press.T.tocsr()

    def solve(self, stiffness: Array, right: Array, reduction: float, size: float) -> Array:
        """Return the unknowns (N,) at which springs of ``stiffness`` (n_c,) balance the forces
        ``right`` (N,).

        Iterations end when the rest has fallen by ``reduction``, or is what rounding leaves of
        forces of a ``size``.
        """
        out = np.zeros(len(right))
        if not len(self.free):
            return out
        scale = float(np.mean(stiffness))
        springs, aim = stiffness / scale, self._stay(right[self.free] / scale)
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
            found, count, fine = conjugate_gradients(
                apply, self.inverse, aim, reduction, most, floor, True
            )
            if fresh or (count < most and fine):
                break
            self.inverse = None
        out[self.free] = found
        return out

    @staticmethod
    def _matrix(press: Any, stiffness: Array, hold: float) -> Any:
        """Return B^T K B, with springs that hold each unknown."""
        from scipy.sparse import diags_array, eye_array

        return (
            press.T @ (diags_array(stiffness) @ press) + hold * eye_array(press.shape[1])
        ).tocsc()

    def _invert(self, stiffness: Array) -> Callable[[Array], Array]:
        """Return an approximate inverse of B^T K B, from LU factors of the displacements, or the
        blocks of the balls.

        Strains and walls, which act on all balls, would fill the factors: they have their own
        diagonal.
        """
        d, n = self.frame.dimension, int(np.count_nonzero(self.free < self.frame.n_free))
        squares = self.transposed[n:].multiply(self.transposed[n:])
        diagonal = np.asarray(squares @ stiffness) + _HOLD
        if self.factored:
            matrix = self._matrix(self.press[:, :n], stiffness, _HOLD_LOOSELY)
            factors = factorise(matrix, approximate=True)

            def solve(force: Array) -> Array:
                # single precision has no numbers below 1e-38
                largest = float(np.max(np.abs(force), initial=0.0)) or 1.0
                return np.asarray(
                    factors.solve((force / largest).astype(np.float32)) * largest, float
                )

        else:
            # the inverse blocks (balls, d, d) of the displacements
            columns = [self.press[:, a:n:d] for a in range(d)]
            found = np.array(
                [[one.multiply(other).T @ stiffness for other in columns] for one in columns]
            )
            found = np.moveaxis(found, 2, 0)
            mean = float(np.mean(np.trace(found, axis1=1, axis2=2)))
            blocks = np.asarray(np.linalg.inv(found + 1e-6 * mean * np.eye(d)), float)

            def solve(force: Array) -> Array:
                return np.asarray(np.einsum("nab,nb->na", blocks, force.reshape(-1, d)).ravel())

        return lambda vector: self._stay(
            np.concatenate([solve(self._stay(vector)[:n]), vector[n:] / diagonal])
        )


# -- in the true geometry --------------------------------------------------------------------------


class _Configuration:
    """The contacts and forces of a crystal at unknowns ``x``, in the true geometry.

    ``now`` (n_c, d) are the vectors from ball to ball, ``pull`` (N,) the forces left on the
    unknowns, and ``residual`` is the largest over the ``mean`` force.
    """

    def __init__(self, frame: Frame, springs: Springs, push: Push, x: Array) -> None:
        d = frame.dimension
        v = frame.vector
        p = frame.periods
        self.frame = frame
        self.springs = springs
        self.push = push
        self.x = x
        w = np.asarray(frame.motion @ x).reshape(len(v), d)
        self.now = v + w
        self.r = r = np.where(frame.flat, np.inf, np.linalg.norm(self.now, axis=1))
        self.normal = np.where(
            frame.flat[:, None], v / frame.distance[:, None], self.now / r[:, None]
        )
        stretch = np.einsum("ca,ca->c", 2.0 * v + w, w) / (r + frame.distance)
        overlap = frame.offset - np.where(
            frame.flat, np.einsum("ca,ca->c", self.normal, w), stretch
        )
        self.overlap = np.where(
            np.abs(overlap) <= _ROUNDING * np.max(np.abs(overlap), initial=0.0), 0.0, overlap
        )
        self.force = springs.force(self.overlap)
        self.mean = springs.size(self.force)
        self.deformed = np.eye(p) + frame.strain(x)
        self.area = float(np.linalg.det(self.deformed)) if p else 1.0
        wanted = push.force + (self.area - 1.0) * push.pressed
        if push.stress is not None and p and self.area > 0.0:
            work = push.stress @ np.linalg.inv(self.deformed) * self.area
            wanted[frame.strains] = frame.work_of(0.5 * (work + work.T))
        self.press = frame.along(self.normal)
        self.pull = np.where(push.held, 0.0, wanted - self.press.T @ self.force)
        self.residual = (
            float(np.max(np.abs(self.pull) * frame.weights, initial=0.0)) / self.mean
            if self.mean
            else math.inf
        )
        #: whether balls are apart and touch some others, and the cell is not inside out
        self.is_sound = bool(self.mean and np.all(np.isfinite(x)) and np.all(r > 0.0)) and (
            not p or float(np.min(np.linalg.eigvalsh(self.deformed))) > 0.0
        )

    def at(self, x: Array) -> _Configuration:
        """Return the same crystal at other unknowns."""
        return _Configuration(self.frame, self.springs, self.push, x)

    def among(self, own: Index) -> _Configuration:
        """Return the contacts of balls whose displacements ``own`` are the only unknowns, from this
        place on.
        """
        frame = self.frame
        d = self.frame.dimension
        some = np.unique(frame.motion[:, own].tocoo().row // d)
        rows = (d * some[:, None] + np.arange(d)).ravel()
        vector = np.where(frame.flat[:, None], frame.vector, self.now)[some]
        none = np.zeros((0, 0))
        still = np.zeros(len(own))
        size = len(own)
        held = Frame(
            vector,
            frame.flat[some],
            frame.motion[rows][:, own],
            d,
            none,
            size,
            (),
            (),
            frame.length,
            self.overlap[some],
        )
        push = replace(
            self.push,
            force=self.push.force[own],
            held=still > 0.0,
            given=still,
            stress=None,
            pressed=still,
        )
        return _Configuration(held, self.springs.among(some), push, still)

    @cached_property
    def on_balls(self) -> Array:
        """The force left on each ball that moves, N."""
        return np.asarray(
            np.linalg.norm(self.pull[: self.frame.n_free].reshape(-1, self.frame.dimension), axis=1)
        )

    @cached_property
    def stiffness(self) -> Array:
        """(n_c,) N/m."""
        return self.springs.stiffness(self.overlap)

    @cached_property
    def touch(self) -> Any:
        """(n_c, balls) sparse: the contacts of each ball that moves."""
        from scipy.sparse import csr_array

        d, one = self.frame.dimension, self.frame.motion[:, : self.frame.n_free].tocoo()
        out = csr_array(
            (np.ones(len(one.row)), (one.row // d, one.col // d)),
            (len(self.r), self.frame.n_free // d),
        )
        out.data[:] = 1.0
        return out

    def derive(self, sign: float, added: float = 0.0) -> Any:
        """Return the matrix of Newton's method, without the load's; ``added`` is a stiffness of all
        contacts.
        """
        from scipy.sparse import coo_array

        d, n_c = self.frame.dimension, len(self.r)
        places = np.arange(n_c * d).reshape(n_c, d)
        row = np.repeat(places[:, :, None], d, 2)
        column = np.repeat(places[:, None], d, 1)
        across = sign * self.force / self.r
        block = (
            (self.stiffness + added + across)[:, None, None]
            * self.normal[:, :, None]
            * self.normal[:, None, :]
        )
        block -= across[:, None, None] * np.eye(d)
        middle = coo_array(
            (block.ravel(), (row.ravel(), column.ravel())), shape=(n_c * d, n_c * d)
        ).tocsr()
        return self.frame.motion.T @ (middle @ self.frame.motion)

    def find_step(self, system: _System, sign: float) -> Array:
        """Return the step (N,) of Newton's method; with ``sign`` -1 forces push balls back instead
        of aside.
        """
        from scipy.sparse import coo_array

        if not system.factored:
            system.renew(self.press)
            return system.solve(self.stiffness, self.pull, 1e-4, self.mean)
        mean = float(np.mean(self.stiffness))
        matrix = self.derive(sign, 0.0 if sign > 0.0 else _ADDED * min(1.0, self.residual) * mean)
        if sign > 0.0:  # less the derivative of the load, which follows the cell as that deforms
            frame = self.frame
            push = self.push
            inverse = np.linalg.inv(self.deformed)
            columns = np.zeros((len(self.x), len(frame.pairs)))
            for number, (a, b) in enumerate(frame.pairs):
                change = np.zeros_like(self.deformed)
                change[a, b] = change[b, a] = 1.0 / frame.length
                grown = self.area * float(np.trace(inverse @ change))
                columns[:, number] = grown * push.pressed
                if push.stress is not None:
                    work = push.stress @ (grown * inverse - self.area * inverse @ change @ inverse)
                    columns[frame.strains, number] = frame.work_of(0.5 * (work + work.T))
            row, column = np.nonzero(columns)
            entries = columns[row, column], (row, frame.n_free + column)
            matrix = matrix - coo_array(entries, shape=(len(self.x), len(self.x))).tocsr()
        return _solve_indefinite(matrix, system.free, self.pull, mean)

    def search(self, step: Array) -> _Configuration:
        """Go along a step until the energy no longer falls much: its slope is that of the forces
        left.
        """
        first = float(self.pull @ step)
        low = 0.0
        high = math.inf
        length = 1.0
        for _ in range(_SLOPES):
            there = self.at(self.x + length * step)
            slope = float(there.pull @ step) if there.is_sound else -math.inf
            if abs(slope) <= 0.3 * abs(first) or (slope > 0.0 and length >= 1.0):
                break
            low, high = (length, high) if slope > 0.0 else (low, length)
            length = 0.5 * (low + high)
        return there

    def lead(self, loose: Flags, least: float) -> _Configuration:
        """Bring ``loose`` balls to rest, while the others are held: to ``least`` of the mean
        force.
        """
        from scipy.sparse.csgraph import connected_components

        d, mean = self.frame.dimension, float(np.mean(self.stiffness))
        own = np.flatnonzero(np.repeat(loose, d))
        here = self.among(own)
        for _ in range(_LOOSE_STEPS):
            left = here.on_balls / self.mean
            if np.max(left) <= least:
                break
            held = np.repeat(_ADDED * np.minimum(1.0, left), d)
            step = _solve_indefinite(here.derive(-1.0), np.arange(len(own)), here.pull, mean, held)
            touch = here.touch[
                np.flatnonzero((here.force > 0.0) | (here.at(here.x + step).force > 0.0))
            ]
            count, group = connected_components(touch.T @ touch, directed=False)
            most = np.zeros(count)
            np.maximum.at(most, group, left)
            group = np.repeat(group, d)
            done = most <= least
            first = np.bincount(group, here.pull * step, count)
            low = np.zeros(count)
            high = np.full(count, np.inf)
            length = np.where(done, 0.0, 1.0)
            for _ in range(_LENGTHS):
                there = here.at(here.x + length[group] * step)
                slope = np.bincount(group, there.pull * step, count)
                low = np.where(slope > 0.0, length, low)
                high = np.where(slope < 0.0, length, high)
                done |= (np.abs(slope) <= 0.3 * first) | ((slope >= 0.0) & (high == np.inf))
                if np.all(done):
                    break
                length = np.where(done, length, 0.5 * (low + np.where(done, low, high)))
            here = there
        x = self.x.copy()
        x[own] += here.x
        return self.at(x)

    def go_down(self, system: _System) -> _Configuration | None:
        """Return where to go on from a saddle of the energy; None at a minimum."""
        from scipy.sparse import eye_array

        frame = self.frame
        balls = system.free[system.free < self.frame.n_free]
        mean = float(np.mean(self.stiffness))
        own = (self.derive(1.0).tocsr()[balls][:, balls] / mean).tocsc()
        # forces push no ball aside more than twice all that act on one
        most = (
            4.0
            * float(np.max((np.abs(frame.press.T) @ (self.force / self.r))[: frame.n_free]))
            / mean
        )
        solve = factorise(own + most * eye_array(len(balls))).solve
        value, vector = find_nearest(own, 1, -most, solve, np.cos(np.arange(len(balls)) ** 2.0))
        if value[0] > -_DOWN * most:
            return None
        way = np.zeros_like(self.x)
        way[balls] = (
            vector[:, 0]
            * 1e-2
            * float(np.max(np.abs(frame.offset)))
            / float(np.max(np.abs(vector)))
        )
        way *= math.copysign(1.0, float(self.pull @ way))
        for doubling in range(_DOUBLINGS):
            ahead = self.at(self.x + 2.0**doubling * way)
            if doubling and float(ahead.pull @ way) < 0.0:
                break
            there = ahead
        return there


def settle_exactly(frame: Frame, springs: Springs, push: Push, start: Rest) -> Rest:
    """Find the state at rest where contacts turn and the cell deforms, from that at small overlap.

    Where radii differ, contacts open, and balls that they held lean on others. As in the simulation
    of a packing (:mod:`granphon.array.true_equilibrium`), these loose balls are brought to rest
    first, while the others are held: in clusters of those that touch, each with steps of its own
    length, and with the other sign of -f/r, by which a step is about as long as a ball is far from
    the line between two others. Newton's method for all follows, and so on in turn. A step that
    would raise the energy is replaced by one downhill, and where neither the loose balls nor the
    others let each other come to rest, all move together. Where balls are at rest but the energy is
    not least, they go downhill along the softest motion.

    Raises :class:`~granphon.base.errors.InstabilityError` if there is none near it,
    :class:`~granphon.base.errors.ConvergenceError` if balls that differ do not come to rest, and
    :class:`~granphon.base.errors.MechanismError` if balls differ and some of their motions, while
    all touch, cost no energy.
    """
    if not (np.any(start.overlap) or np.any(push.force)):
        return start  # bonds without a load
    differ = bool(np.any(frame.offset))
    best = math.inf
    stalled = 0
    kept = start
    saddles = 0
    system = _System(frame, frame.press, push.held)
    here = _Configuration(frame, springs, push, start.x.copy())
    loose = np.zeros(frame.n_free // frame.dimension, bool)
    if differ:
        if system.is_floppy:
            what = f"balls that differ do not come to rest in the true geometry under {push.words}"
            why = (
                "The crystal does not stand without friction: motions in which no contact is"
                " pressed cost no energy"
            )
            raise MechanismError(
                what, why, f"{_STAY}; or take a crystal with more contacts, such as fcc"
            )
        ratio = float(np.max(np.abs(frame.offset)) / np.mean(frame.distance))
        loose = here.touch.T @ (here.force > _LIGHT * here.mean) <= frame.dimension
    for _ in range(_STEPS):
        if here.is_sound and np.any(loose) and stalled <= _PATIENT:
            others = float(np.max(here.on_balls, where=~loose, initial=0.0)) / here.mean
            here = here.lead(loose, max(_TOLERANCE, _OF_LOOSE * min(ratio, others)))
        if not here.is_sound:
            break
        stalled = stalled + 1 if here.residual > 0.5 * best else 0
        if here.residual < best:
            best = here.residual
            kept = Rest(here.x, here.overlap, here.normal, here.residual)
        if here.residual <= (_TOLERANCE if system.direct else _ITERATED) or (
            best <= _REQUIRED and stalled > 2
        ):
            if not differ:
                return kept
            down = (
                here.at(kept.x).go_down(system) if system.factored and saddles < _SADDLES else None
            )
            if down is None:
                return kept if springs.adhere else replace(kept, overlap=_open_light(springs, kept))
            here = down
            best = math.inf
            stalled = 0
            saddles = saddles + 1
            continue
        if stalled > (4 if differ else 1) * _PATIENT or not np.any(here.stiffness):
            break
        before = here.residual
        step = here.find_step(system, 1.0)
        there = here.at(here.x + step)
        # steps up the energy would go round in circles, or back to a saddle: the slopes at both
        # ends tell
        if differ:
            falls = (
                there.is_sound and here.pull @ step > 0.0 and (here.pull + there.pull) @ step >= 0.0
            )
            if not (falls and there.residual < _TOO_FAR):
                there = here.search(here.find_step(system, -1.0))
            loose = loose | (there.on_balls > _FAILED * before * there.mean)
        here = there
    if differ:
        what = f"balls that differ have not come to rest in the true geometry under {push.words}"
        left = f"A force of {best:.2g} of the mean is left on a ball"
        raise ConvergenceError(what, left, f"{_STAY}; or press loose balls more")
    why = "Its contacts turn away under the load, and nothing holds it"
    mend = "Lower the load, or add contacts"
    raise InstabilityError(f"the crystal collapses under {push.words}", why, mend)


def _open_light(springs: Springs, rest: Rest) -> Array:
    """Return the overlaps (n_c,), without those whose force may be a residual only: their stiffness
    would hold a ball.
    """
    force = springs.force(rest.overlap)
    light = np.abs(force) <= CARRIED_FORCE * rest.residual * springs.size(force)
    return np.where(light, np.minimum(rest.overlap, springs.least), rest.overlap)


def _solve_indefinite(
    matrix: Any, free: Index, right: Array, scale: float, held: Array | float = 0.0
) -> Array:
    from scipy.sparse import diags_array

    out = np.zeros(len(right))
    if len(free):
        own = (
            matrix.tocsr()[free][:, free] / scale + diags_array(np.full(len(free), _HOLD) + held)
        ).tocsc()
        out[free] = factorise(own).solve(right[free]) / scale
    return out


# -- what cannot be --------------------------------------------------------------------------------


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
            bounds = [
                (one, None) for one in [*least.tolist(), *[0.0] * (columns.shape[1] - len(least))]
            ]
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
                # or else it only takes the load off
                presses = np.max(np.abs(found.x[:-1])) > 1e-9 * found.x[-1]
                mend = (
                    f"A pressure {'of' if presses else 'above'} {needed:.4g} {unit} from all"
                    f" sides in addition would do"
                )
    if not borne:
        what = f"the crystal cannot bear {push.words}"
        why = "Contacts only push along the lines of their centres, and no such forces add up to it"
        if springs.adhere:
            why = (
                "No forces along the lines of the centres, up to the tension that contacts bear,"
                " add up to it"
            )
        mend = mend or "Press the crystal from the sides too, or give another load"
        return InputError(what, *(push.lifted or (why, mend)))
    if opened:
        why = "Balls that do not touch have no stiffness"
        return InputError(f"all contacts are open under {push.words}", why, "Press them")
    size = typical_force(frame, push, springs)
    with np.errstate(all="ignore"):
        reached = springs.overlap(np.full(springs.count, size))
        stiffness = springs.stiffness(reached)
    if not np.all(np.isfinite(reached)):
        why = f"They are about {size:.4g} N, and the law has no overlap at that force"
        mend = "Lower the load, or give a law whose force grows on"
        return InputError(f"a contact law does not reach the forces under {push.words}", why, mend)
    loads = np.abs(push.force * frame.weights)
    for what, values, most in (
        ("the stiffnesses of contacts", stiffness, _MOST_STIFF),
        ("the forces of the load on balls", loads, _MOST_FORCES),
    ):
        if (
            np.any(values)
            and (apart := float(np.max(values) / np.min(values[values > 0.0]))) > most
        ):
            what = (
                f"the crystal has not come to rest under {push.words}, where {what} differ by a"
                f" factor of {apart:.2g}"
            )
            why = f"A factor of up to {most:g} can be told from rounding"
            return InputError(what, why, "Compare the units, or leave the smaller ones out")
    left = "" if residual is None else f"A force of {residual:.2g} of the mean is left on a ball"
    return ConvergenceError(f"the crystal has not come to rest under {push.words}", left)
