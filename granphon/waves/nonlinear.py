"""Balls of a network that move by the whole of the law of their contacts, in time.

Mass-weighted motions x = M^1/2 u (rotations carried by w = R_g phi) obey

    x'' = A^T ((f(h) - f_0) e_n - (T - T_0)) + forces,    A = C M^-1/2

where C x are the deformations of contacts (:mod:`granphon.dynamics.rows`), in the directions of the network: displacements
are small against the balls, not against the overlaps. h = h_0 - elongation is the overlap. A contact pushes by its law while
h > 0, and is open otherwise. f_0 and T_0 are the static forces, which the load holds in balance.

Slip, twist and rolling s are resisted by forces T with the stiffness k_t, which is in proportion to the normal stiffness
k(h): dT = k_t ds while h rises, and T over k_t is kept while h falls; Coulomb's limit |T| <= mu f holds for slip. It is the
law of :mod:`granphon.array.friction`. Dashpots add tau k_0 times the rate of a deformation while the contact is closed.

Steps are those of Verlet in velocity form: symplectic and, without losses, the same backwards. The stored energy is known in
closed form, so that its sum with the kinetic energy and the losses shows what the steps leave: it goes with their square.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls import hertz
from granphon.balls.contact_laws import Hertz, PowerLaw
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.validation import not_negative, positive, real_array, whole_number
from granphon.dynamics.damping import ContactDamping
from granphon.dynamics.rows import weigh_rows
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.motion import Motion
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import read_balls, read_vector

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: steps in the shortest period that the contacts could have, by default; and the least number with which steps are stable
_STEPS, _LEAST_STEPS = 60.0, 4.0
#: most steps of a run
_MOST_STEPS = 10_000_000
#: displacement, over the mean diameter, at which a ball has left its place
_AWAY = 0.5


@dataclass(frozen=True)
class Drive:
    """Balls or bodies that are moved, or pushed, along a direction.

    Parameters
    ----------
    balls : index of a ball, or several.
    direction : (3,), or as many numbers as the network has dimensions; a unit vector along it is taken.
    displacement : function of the time, s, that returns the displacement of the balls, m, zero at the time zero. They move
        so whatever acts on them; bodies that are held may be moved.
    force : function of the time, s, that returns the force on each of the balls, N. Give one of both.
    """

    balls: Any
    direction: ArrayLike
    displacement: Callable[[float], float] | None = None
    force: Callable[[float], float] | None = None


class _Powers:
    """Normal forces f = c h_+^a of contacts, as functions of their elongation e = h_0 - h from rest."""

    def __init__(self, exponent: float, rest: Array, overlap: Array) -> None:
        self.exponent, self.rest, self.overlap, self.root = exponent, rest, overlap, np.sqrt(overlap)
        self.coefficient = rest / overlap**exponent

    def press(self, elongation: Array) -> tuple[Array, Array]:
        """Return f - f_0, without a difference of near-equal forces, and the stiffness."""
        if self.exponent == hertz.EXPONENT:
            change, _, root = hertz.stretch(self.overlap, self.root, elongation)
            return self.coefficient * change, hertz.stiffness_of(self.coefficient * root)
        a, part = self.exponent, np.maximum(1.0 - elongation / self.overlap, 0.0)
        with np.errstate(divide="ignore"):
            change = self.rest * np.expm1(a * np.log1p(np.maximum(-elongation / self.overlap, -1.0)))
        return change, np.where(part > 0.0, a * self.rest / self.overlap * part ** (a - 1.0), 0.0)

    def store(self, elongation: Array) -> Array:
        """Return the energy of each contact and of its share of the load, J, since rest: zero at e = 0, and never below."""
        if self.exponent == hertz.EXPONENT:
            return np.asarray(self.coefficient * hertz.stretch(self.overlap, self.root, elongation)[1])
        a, part = self.exponent, np.maximum(1.0 - elongation / self.overlap, 0.0)
        return np.asarray(self.rest * (self.overlap * (part ** (a + 1.0) - 1.0) / (a + 1.0) + elongation))


class NonlinearWaves:
    """The motion of balls by the whole of their contact law: pulses of any height, impacts, contacts that open.

    Parameters
    ----------
    x : a state at one load, a sample, or a :class:`~granphon.ContactNetwork`, at rest under its load. A sample that was
        pressed with friction starts with its tangential forces.
    law : of the normal forces: :class:`~granphon.Hertz` (default), or a :class:`~granphon.PowerLaw` whose exponent is taken.
        The coefficient and the overlap of each contact follow from its force f and stiffness k: overlap a f/k.
    friction_coefficient : mu of Coulomb's limit of slip; by default contacts do not slide.
    damping : viscosity of contacts over their stiffness at rest, s, as in :meth:`Waves.response`: a number or (n_c,), or a
        tuple of that of normal and of all other motion.

    Displacements are small against the balls: contacts keep the directions and lever arms of the network, and are those of
    the network; they open and close.

    Raises
    ------
    InputError : no network; contacts without force, whose overlap is not known; a law that is no power; a network with
        ``prestress``, whose static forces act sideways; numbers out of range.
    """

    def __init__(
        self, x: Any, law: Any = None, *, friction_coefficient: float = math.inf, damping: Any = 0.0,
    ) -> None:  # fmt: skip
        self.network: ContactNetwork = given_network(x)
        if not isinstance(law, Hertz | PowerLaw | None):
            why = "The overlaps of a network follow from forces and stiffnesses of a power alone"
            raise InputError(f"law is {brief(law)}", why, "Give gp.Hertz() or gp.PowerLaw(...)")
        self.exponent = law.exponent if isinstance(law, PowerLaw) else hertz.EXPONENT
        force, stiffness = self.network.normal_force, self.network.normal_stiffness
        if not np.all(force > 0.0):
            what = f"{np.count_nonzero(force <= 0.0)} of {force.size} contacts have no force"
            raise InputError(what, "Their overlap is not known", "Press the network, or leave them out")
        self.overlap: Array = self.exponent * force / stiffness
        if self.network.prestress:
            why = "Contacts keep their directions in this motion, and static forces would turn them"
            raise InputError("static forces act sideways in this network", why, "Leave finite_overlap or prestress off")
        self._powers = _Powers(self.exponent, force, self.overlap)
        self.mu = (
            friction_coefficient
            if friction_coefficient == math.inf
            else not_negative("friction_coefficient", friction_coefficient)
        )
        self.damping = ContactDamping.of(self.network, damping).times

    def __repr__(self) -> str:
        network = self.network
        return f"NonlinearWaves({network.n_balls:,} balls, {network.n_contacts:,} contacts, f ~ overlap^{self.exponent:g})"

    def run(
        self, duration: float, positions: ArrayLike | None = None, velocities: ArrayLike | None = None,
        drive: Drive | Sequence[Drive] | None = None, *, displacements: ArrayLike | None = None,
        rotations: ArrayLike | None = None, spins: ArrayLike | None = None, frames: int = 201, step: float | None = None,
    ) -> Motion:  # fmt: skip
        """Let the balls move for a ``duration``, s.

        Parameters
        ----------
        positions : where the balls start, (n, 3) or (n, d), m; by default those of the network. Their ``displacements`` from
            there, m, keep the digits that positions lose: give one of both.
        velocities, rotations, spins : at the start, (n, 3) or (n, d), m/s, rad and rad/s; zero by default. Contacts have
            come to the start without sliding, but for Coulomb's limit.
        drive : a :class:`Drive`, or several.
        frames : number of times that are kept, the start and the end among them.
        step : s, of which a frame has a whole number; by default a sixtieth of the shortest period that the stiffest contact
            allows. It is halved, and the run begins anew, if contacts become much stiffer.

        Raises
        ------
        InputError : shapes and numbers that are not allowed; a drive of nothing, or a force on a body that is held; a
            ``step`` too long for the stiffest contact.
        ConvergenceError : a ball leaves its place by half of its diameter.
        """
        length, count = positive("duration", duration, "s"), whole_number("frames", frames, 2)
        drives: list[Any] = [] if drive is None else list(drive) if isinstance(drive, list | tuple) else [drive]
        system = _System(self, drives)
        if positions is not None:
            if displacements is not None:
                raise InputError("positions and displacements are given", mend="Give one of both")
            places, d = real_array("positions", positions), self.network.dimension
            if places.shape not in ((self.network.n_balls, 3), (self.network.n_balls, d)):
                what = f"positions has the shape {places.shape}"
                raise InputError(what, mend=f"Give ({self.network.n_balls}, 3) numbers, one row for each ball")
            displacements = places - self.network.positions[:, : places.shape[1]]
        start = [system.read(name, one) for name, one in (
            ("displacements", displacements), ("velocities", velocities), ("rotations", rotations), ("spins", spins)
        )]  # fmt: skip
        x, v = start[0] + start[2], start[1] + start[3]
        wanted = positive("step", step, "s") if step is not None else system.choose_step(x, v)
        while True:
            each = max(1, math.ceil(length / (count - 1) / wanted))
            if each * (count - 1) > _MOST_STEPS:
                what = f"the run takes {each * (count - 1):.3g} steps"
                raise InputError(what, f"More than {_MOST_STEPS:.0e} are not made", "Give a shorter duration")
            found = system.integrate(x, v, length / (count - 1) / each, each, count)
            if found is not None:
                return found
            if step is not None:
                what = f"the step of {wanted:.3g} s is too long"
                raise InputError(what, "Contacts become so stiff that it is not stable", "Leave step out")
            wanted *= 0.5


class _System:
    """The equations of motion of a network with drives."""

    def __init__(self, waves: NonlinearWaves, drives: Sequence[Any]) -> None:
        network, self.drives, masses = waves.network, drives, waves.network.masses.copy()
        self.resting = network
        self.moved: list[tuple[Index, Array]] = []
        for one in drives:
            if not isinstance(one, Drive) or (one.displacement is None) == (one.force is None):
                raise InputError(f"drive is {brief(one)}", mend="Give a Drive with a displacement or a force")
            balls, along = (
                read_balls("drive", one.balls, network),
                read_vector("direction", one.direction, network.dimension),
            )
            if one.force is not None and not np.all(network.moving[balls]):
                raise InputError("a force acts on a body that is held", mend="Give its displacement")
            self.moved.append((balls, along))
            if one.displacement is not None:
                masses[balls] = np.inf
        self.network = replace(network, masses=masses)
        self.operator = operator = WaveOperator(self.network)
        self.rows, n = operator.rows, network.n_contacts
        self.powers, self.mu = waves._powers, waves.mu
        self.forward = operator.compose(self.rows)
        self.back = self.forward.T.tocsr()
        self.ratio = np.array([row.stiffness / network.normal_stiffness for row in self.rows[1:]]).reshape(-1, n)
        self.slips = np.array([row.kind == "slip" for row in self.rows[1:]], bool)
        self.viscosity = weigh_rows(self.rows, waves.damping)
        self.viscosity = self.viscosity * np.array([np.broadcast_to(row.stiffness, n) for row in self.rows])
        self.held = np.zeros((len(self.rows) - 1, n))
        if network.tangential_force is not None:
            axes = list(operator.motions.translations)
            for place in np.flatnonzero(self.slips).tolist():
                self.held[place] = -np.sum(
                    network.tangential_force[:, axes] * self.rows[1 + place].head[:, : len(axes)], axis=1
                )
        # what a unit displacement of driven balls adds to the deformations, and a unit force to the accelerations
        self.strain, self.push = np.zeros((len(drives), len(self.rows) * n)), np.zeros((len(drives), operator.size))
        for number, (one, (balls, along)) in enumerate(zip(drives, self.moved, strict=True)):
            vector = np.zeros(operator.motions.count)
            for place, axis in enumerate(operator.motions.translations):
                vector[place] = along[axis]
            driven = np.isin(np.arange(network.n_balls), balls)
            if one.displacement is not None:
                self.strain[number] = np.concatenate([
                    np.where(driven[network.j], row.head @ vector, 0.0) - np.where(driven[network.i], row.tail @ vector, 0.0)
                    for row in self.rows
                ])  # fmt: skip
            else:
                field = np.where(driven[:, None], vector, 0.0)[operator.balls]
                self.push[number] = operator.vector(field / np.sqrt(network.masses[operator.balls])[:, None])
        self._reach = abs(self.back)

    def read(self, name: str, given: ArrayLike | None) -> Array:
        """Return vectors of balls (n, 3) or (n, d) as mass-weighted motions (size,)."""
        operator, network = self.operator, self.network
        out = np.zeros((operator.balls.size, operator.motions.count))
        if given is None:
            return np.asarray(operator.vector(out))
        values, d = real_array(name, given), network.dimension
        if values.shape not in ((network.n_balls, 3), (network.n_balls, d)) or not np.all(np.isfinite(values)):
            what = f"{name} has the shape {values.shape}"
            raise InputError(what, mend=f"Give ({network.n_balls}, 3) finite numbers, one row for each ball")
        turns = name in ("rotations", "spins")
        axes = operator.motions.rotations if turns else operator.motions.translations
        columns = operator.motions.turning if turns else operator.motions.translating
        if values.shape[1] <= max(axes, default=0):
            raise InputError(f"{name} has the shape {values.shape}", mend=f"Give ({network.n_balls}, 3)")
        weight = np.sqrt((network.inertias if turns else network.masses)[operator.balls])[:, None]
        out[:, columns] = values[operator.balls][:, list(axes)] * weight
        return np.asarray(operator.vector(out))

    def find_top(self, stiffness: Array) -> float:
        """Return a bound of the angular frequencies of contacts of a normal ``stiffness`` (n_c,), rad/s."""
        each = np.concatenate([stiffness[None], self.ratio * stiffness])
        rows = self._reach.T @ np.ones(self._reach.shape[0])
        return math.sqrt(float(np.max(self._reach @ (each.ravel() * rows))))

    def choose_step(self, x: Array, v: Array) -> float:
        """Return a step for the contacts at the start, and for those that the fastest ball would press by its own energy."""
        powers = self.powers
        energy = 0.5 * float(np.max(np.sum(self.operator.values(v) ** 2, axis=1), initial=0.0))
        a = powers.exponent
        deep = (energy * (a + 1.0) / powers.coefficient + powers.overlap ** (a + 1.0)) ** (1.0 / (a + 1.0))
        _, stiffness = powers.press(np.minimum(powers.overlap - deep, (self.forward @ x)[: len(deep)]))
        return 2.0 * math.pi / _STEPS / self.find_top(stiffness)

    def _limit(self, t: Array, change: Array) -> Array:
        """Return forces ``t`` (kinds, n_c), those of slip within Coulomb's limit of the normal force f_0 + ``change``."""
        if self.mu < math.inf and np.any(self.slips):
            size = np.sqrt(np.sum(t[self.slips] ** 2, axis=0))
            most = self.mu * np.maximum(change + self.powers.rest, 0.0)
            t[self.slips] *= np.divide(most, size, out=np.ones_like(size), where=size > most)
        return t

    def integrate(self, x: Array, v: Array, step: float, each: int, count: int) -> Motion | None:
        """Return the motion of ``count`` frames of ``each`` steps; None if contacts become too stiff for the step."""
        operator, powers, n = self.operator, self.powers, self.network.n_contacts
        x, v, slip_rows = x.copy(), v.copy(), len(self.rows) - 1
        dashed, opens = bool(np.any(self.viscosity)), self.powers.overlap
        given = [one.displacement for one in self.drives], [one.force for one in self.drives]

        def follow(functions: list[Any], time: float) -> Array:
            return np.array([0.0 if one is None else float(one(time)) for one in functions])

        place, lift = follow(given[0], 0.0), follow(given[1], 0.0)
        if np.any(place):
            raise InputError("a displacement does not begin at zero", mend="Give a function that is zero at zero")
        e = (self.forward @ x + place @ self.strain).reshape(-1, n)
        change, k = powers.press(e[0])
        t = self._limit(self.held + self.ratio * k * e[1:], change)
        dash = np.where(e[0] < opens, self.viscosity * (self.forward @ v).reshape(-1, n), 0.0)
        pull = np.concatenate([change[None], self.held - t]) - dash
        accelerate = self.back @ pull.ravel() + lift @ self.push
        lost = work = 0.0
        kept: list[tuple[Any, ...]] = []

        turning = operator.vector(
            np.broadcast_to(operator.motions.is_rotation, (operator.balls.size, operator.motions.count))
        )

        def keep(time: float, f: Array) -> None:
            square = v * v
            k_t = self.ratio * k
            springs = np.divide(t * t, 2.0 * k_t, out=np.zeros_like(t), where=k_t > 0.0)
            stored = float(np.sum(powers.store(e[0])) + np.sum(springs) - at_rest - np.sum(self.held * e[1:]))
            size = np.sqrt(np.sum(t[self.slips] ** 2, axis=0))
            kinetic = [0.5 * float(np.sum(square[chosen])) for chosen in (~turning, turning)]
            kept.append((time, x.copy(), v.copy(), f, size, *kinetic, stored, lost, work, place))

        rest_k = self.ratio * powers.press(np.zeros(n))[1]
        at_rest = float(np.sum(np.divide(self.held**2, 2.0 * rest_k, out=np.zeros_like(t), where=rest_k > 0.0)))
        keep(0.0, np.maximum(change + powers.rest, 0.0))
        limit = (2.0 * math.pi / _LEAST_STEPS / step) ** 2
        for number in range(1, each * (count - 1) + 1):
            half = v + 0.5 * step * accelerate
            x += step * half
            before, before_t, before_k, before_place, before_lift, before_dash = e, t, k, place, lift, dash
            if self.drives:
                place, lift = follow(given[0], number * step), follow(given[1], number * step)
            e = (self.forward @ x).reshape(-1, n)
            if self.drives:
                e += (place @ self.strain).reshape(-1, n)
            moved, old_change = e - before, change
            change, k = powers.press(e[0])
            if slip_rows:
                k_t, old_k = self.ratio * k, self.ratio * before_k
                rises = moved[0] < 0.0
                elastic = np.divide(t, old_k, out=np.zeros_like(t), where=old_k > 0.0) + moved[1:]
                t = np.where(rises, t + 0.5 * (k_t + old_k) * moved[1:], k_t * elastic)
                t = self._limit(t, change)
                springs = np.sum(np.divide(t * t, 2.0 * k_t, out=np.zeros_like(t), where=k_t > 0.0))
                springs -= np.sum(np.divide(before_t**2, 2.0 * old_k, out=np.zeros_like(t), where=old_k > 0.0))
                lost += float(0.5 * np.sum((t + before_t) * moved[1:]) - springs)
            pull = np.concatenate([change[None], self.held - t])
            if dashed:
                # the speed at the end of the step, but for what dashpots change within it
                rate = (self.forward @ (half + 0.5 * step * accelerate)).reshape(-1, n)
                if self.drives:
                    rate += ((place - before_place) / step @ self.strain).reshape(-1, n)
                dash = np.where(e[0] < opens, self.viscosity * rate, 0.0)
                pull = pull - dash
                lost += float(0.5 * np.sum((dash + before_dash) * moved))
            accelerate = self.back @ pull.ravel()
            if self.drives:
                # bodies that are moved do the work of what resists them, forces that of the ways of balls
                tension = 0.5 * np.concatenate([-(change + old_change)[None], t + before_t - 2.0 * self.held])
                tension += 0.5 * (dash + before_dash)
                work += float(tension.ravel() @ ((place - before_place) @ self.strain))
                work += float(0.5 * step * half @ ((lift + before_lift) @ self.push))
                accelerate += lift @ self.push
            v = half + 0.5 * step * accelerate
            if number % each == 0:
                keep(number * step, np.maximum(change + powers.rest, 0.0))
                if self.find_top(k) ** 2 > limit:
                    return None
                away = float(np.max(np.abs(self._to_balls(x, False)), initial=0.0))
                if not away < _AWAY * 2.0 * float(np.mean(self.network.radii[self.network.moving])):
                    what = f"a ball has left its place by {away:.3g} m after {number * step:.4g} s"
                    raise ConvergenceError(what, "Contacts are those of the network", "Give a smaller motion")
        return self._collect(kept, step)

    def _to_balls(self, vector: Array, turns: bool) -> Array:
        """Return mass-weighted motions (..., size) as vectors (..., n, 3): displacements, or rotations."""
        operator, network = self.operator, self.network
        values = operator.values(vector.T)  # (n_free, motions, ...)
        values = np.moveaxis(values, (0, 1), (-2, -1))
        axes = operator.motions.rotations if turns else operator.motions.translations
        columns = operator.motions.turning if turns else operator.motions.translating
        weight = np.sqrt((network.inertias if turns else network.masses)[operator.balls])[:, None]
        out = np.zeros((*values.shape[:-2], network.n_balls, 3))
        whole = np.zeros((*values.shape[:-1], 3))
        whole[..., list(axes)] = values[..., columns] / weight
        out[..., operator.balls, :] = whole
        return out

    def _collect(self, kept: list[tuple[Any, ...]], step: float) -> Motion:
        times, x, v, forces, shears, translation, rotation, stored, lost, work, places = (
            np.array(one) for one in zip(*kept, strict=True)
        )
        displacements, velocities = self._to_balls(x, False), self._to_balls(v, False)
        for one, ways, (balls, along) in zip(self.drives, places.T, self.moved, strict=True):
            if one.displacement is not None:
                displacements[:, balls] = ways[:, None, None] * along
                velocities[:, balls] = np.gradient(ways, times)[:, None, None] * along
        return Motion(
            times, displacements, velocities, self._to_balls(x, True), self._to_balls(v, True), forces, shears, translation,
            rotation, stored, lost, work, step, self.resting,
        )  # fmt: skip
