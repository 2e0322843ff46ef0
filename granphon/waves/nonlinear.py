"""Balls of a network that move by the whole of the law of their contacts, in time.

Mass-weighted motions x = M^1/2 u (rotations carried by w = R_g phi) obey

    x'' = A^T ((f(h) - f_0) e_n - (T - T_0)) - Gamma x' + forces,    A = C M^-1/2

where C x are the deformations of contacts, in the directions of the network or in the true ones,
and f and T are their forces (:mod:`granphon.contacts.motion`). f_0 and T_0 are the static forces,
which the load holds in balance. In the directions of the network displacements are small against
the balls, not against the overlaps.

There are two schemes. Verlet's steps in velocity form are explicit, symplectic and, without losses,
the same backwards; the sum of energies, each known in closed form, differs from a constant by the
square of the step, which wanders where contacts open: the force has no second derivative there. The
drag Gamma is that of the velocity at the end of a step, which follows in closed form.
Steps of "midpoint" take the velocity and the geometry at the middle, and of each contact the mean
force: of normal forces the change of the energy over that of the overlap, of others the mean of
both ends. What forces then do is what energies change by (the discrete gradient of D. Greenspan,
Discrete Models, 1973, and O. Gonzalez, J. Nonlinear Sci. 6, 449, 1996), so that the sum closes to
rounding, with losses too. They are implicit, and solved by iteration.

Where the force of a contact jumps, as that of balls that adhere does when they touch or part, a
step ends, and the next has the other force: so both schemes stay of second order. The instant is
that at which the way of the balls, as the step has it, comes to the overlap of the jump.
"""

from __future__ import annotations

import math
import os
import warnings
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls import hertz
from granphon.balls.ball import RIGID_PLANE
from granphon.balls.contact_laws import (
    DMT,
    JKR,
    Hertz,
    PowerLaw,
    TabulatedLaw,
    law_between,
    punch_stiffness,
)
from granphon.balls.hertz import HertzLaw
from granphon.balls.neighbours import find_pairs, select_once
from granphon.base.arrays import Array, Index
from granphon.base.compiled import UNCOMPILED
from granphon.base.errors import InputError, LimitWarning, StoppedEarlyWarning, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, silent
from granphon.base.threads import single_products
from granphon.base.validation import (
    index_array,
    not_negative,
    one_of,
    positive,
    real_array,
    real_number,
    whole_number,
)
from granphon.contacts.laws import ContactLaws
from granphon.contacts.motion import MetPairs, MovingContacts, measure_along
from granphon.contacts.motion_laws import PairLaws, Powers
from granphon.contacts.motion_loops import Moment, Rules, drift, gather, kick, spread
from granphon.dynamics.damping import Losses
from granphon.media.cost import motion_memory
from granphon.media.crystal import Crystal, CrystalState
from granphon.media.limits import check_limit
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.motion import Frames, Motion
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import read_vector, require_moves
from granphon.waves.settings import (
    COULOMB_LIMITS,
    FRAMES,
    GEOMETRIES,
    SCHEMES,
    VISCOUS_PULLS,
)

#: steps in the shortest period that the contacts could have, by default; and the least number with
#: which steps are stable
_STEPS = 60.0
_LEAST_STEPS = 4.0
#: least number of the steps that a run chooses, in the shortest period at any time
_FEWEST_STEPS = 30.0
#: depths among which the one is sought to which a ball presses a contact: the least, over the mean
#: radius; the ratio of two that follow each other, by which the stiffness of Hertz's law rises by
#: an eighth; and their number, up to far above any
_LEAST_DEPTH = 1e-12
_DEPTH_RATIO = 1.25
_N_DEPTHS = 201
#: stiffnesses, N/m, among which the greatest is sought that a step allows
_STIFFNESSES = np.geomspace(1e-30, 1e30, 14_001)
#: share of a step that counts for rounding, where a given step divides the time from frame to frame
_ROUNDING = 1e-12
#: how often a step that is too long is halved
_HALVINGS = 10
#: most steps of a run
_MOST_STEPS = 10_000_000
#: displacement, over the mean diameter, at which a ball has left its place among directions that do
#: not turn
_AWAY = 0.5
#: kind of the balls of a network that names none
_BALL = "ball"
#: distance over the mean diameter up to which balls are listed as ones that may meet
_SKIN = 0.2
#: relative change at which an implicit step is solved, that up to which one that does not fall is
#: rounding, most iterations
_SOLVED = 1e-14
_ROUNDED = 1e-9
_ITERATIONS = 50
#: relative difference of coefficients of contacts, over the roots of their radii, that are those of
#: one material
_ALIKE = 1e-2
#: share of a step in which contacts that join or part do so at once: of the energy of a jump within
#: a step, no more is lost
_TOGETHER = 1e-6
#: how often a contact joins and parts in a step, from which it rattles there
_RATTLES = 20


@dataclass(frozen=True)
class Drive:
    """Balls or bodies that are moved, or pushed, along a direction.

    Parameters
    ----------
    balls : index of a ball, or several.
    direction : (3,), or as many numbers as the network has dimensions; a unit vector along it is
        taken.
    displacement : function of the time, s, that returns the displacement of the balls, m, zero at
        the time zero. They move so whatever acts on them; bodies that are held may be moved.
    force : function of the time, s, that returns the force on each of the balls, N. Give one of
        both.

    Where a run has displacements, all functions are also asked for the time one step after its end,
    by which the last velocities are found. They need not be finite there.
    """

    balls: Any
    direction: ArrayLike
    displacement: Callable[[float], float] | None = None
    force: Callable[[float], float] | None = None


class NonlinearWaves:
    """The motion of balls by the whole of their contact law: pulses of any height, impacts,
    contacts that open.

    Parameters
    ----------
    x : a state at one load, a sample, or a :class:`~granphon.ContactNetwork`, at rest under its
        load; or a :class:`~granphon.Crystal`, whose balls touch without load. A sample that was
        pressed with friction starts with its tangential forces.
    law : of the normal forces; by default that of a crystal, and elsewhere
        :class:`~granphon.Hertz`. Of a :class:`~granphon.PowerLaw` the exponent is taken: the
        coefficient and the overlap of each contact follow from its force f and stiffness k, the
        overlap as a f/k. Other laws are the same for all pairs. The :class:`~granphon.Crystal`
        itself gives its network, once repeated or cut, the laws of its pairs.
    friction_coefficient : mu of Coulomb's limit of slip; by default contacts do not slide.
    damping, drag, dashpot, restitution : as in :meth:`Waves.response`, of the present stiffness of
        contacts. Contacts of balls that meet have the means of (n_c,) numbers. Each collision of
        two balls by Hertz's law alone has the ``restitution``; other laws have another.
    viscous_pull : "whole": where balls part, dashpots pull; "limited": by no more than the law
        pushes, so that both together never pull. A collision then loses less.
    coulomb : "elastic": Coulomb's limit is that of the forces of springs, T <= mu f; "total":
        that of these with the forces of dashpots, as LAMMPS has it.
    geometry : "lattice", the directions of the network: displacements are small against the balls,
        and contacts are those of the network. "exact", the true directions: balls may go anywhere,
        and meet others.
    gravity : (3,) or (d,) acceleration of the balls, m/s2, beside the load that holds a state at
        rest. A state that was found under gravity has that in its load.

    Raises
    ------
    InputError : no network; contacts without force, whose overlap is not known; a law that needs
        the balls of a crystal; a network with ``prestress``, whose static forces act sideways, in
        the directions of the network; numbers out of range.
    """

    def __init__(
        self,
        x: Any,
        law: Any = None,
        *,
        friction_coefficient: float = math.inf,
        damping: Any = 0.0,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
        viscous_pull: Literal["whole", "limited"] = "whole",
        coulomb: Literal["elastic", "total"] = "elastic",
        geometry: Literal["lattice", "exact"] = "lattice",
        gravity: ArrayLike | None = None,
    ) -> None:
        state = x.touch() if isinstance(x, Crystal) else x
        self.network: ContactNetwork = given_network(state)
        self.geometry = one_of("geometry", geometry, GEOMETRIES)
        network = self.network
        if network.prestress and geometry == "lattice":
            why = "Contacts keep their directions in this motion, and static forces would turn them"
            raise InputError(
                "static forces act sideways in this network", why, 'Give geometry="exact"'
            )
        self._laws = self._find_laws(
            law, state if isinstance(state, CrystalState) else None, isinstance(x, Crystal)
        )
        self.normal = self._laws.normal
        self.punch = self._laws.punch
        mu = real_number(friction_coefficient)
        self.mu = (
            mu if mu == math.inf else not_negative("friction_coefficient", friction_coefficient)
        )
        self.losses = Losses.of(
            network, damping, drag=drag, dashpot=dashpot, restitution=restitution
        )
        self.rules = Rules(
            turns=geometry == "exact",
            mu=self.mu,
            pulls=one_of("viscous_pull", viscous_pull, VISCOUS_PULLS) == "whole",
            is_total=one_of("coulomb", coulomb, COULOMB_LIMITS) == "total",
        )
        self.gravity: Array = _read_gravity(gravity, network)

    def __repr__(self) -> str:
        of = f", f ~ overlap^{self.normal.exponent:g}" if isinstance(self.normal, Powers) else ""
        return (
            f"NonlinearWaves({self.network.n_balls:,} balls, {self.network.n_contacts:,}"
            f" contacts{of})"
        )

    @property
    def overlap(self) -> Array:
        """(n_c,) overlaps at rest, m."""
        return self.normal.overlap

    def _find_laws(self, law: Any, state: CrystalState | None, unloaded: bool) -> _Laws:
        """Return the laws of the contacts of the network; InputError if they are not known."""
        crystal = state.crystal if state is not None and law is None else law
        if isinstance(crystal, Crystal) and not (unloaded and law is not None):
            return self._take_crystal(crystal, unloaded)
        if unloaded or isinstance(law, DMT | JKR):
            why = "Its contacts are those of balls of known materials, or of no load"
            raise InputError(
                f"law is {brief(law)}", why, "Give the law to the Crystal, and the Crystal here"
            )
        if isinstance(law, Hertz | PowerLaw | None):
            return self._take_power(law)
        return self._take_law(law)

    def _take_crystal(self, crystal: Crystal, unloaded: bool) -> _Laws:
        """Return the laws of the pairs of a crystal, at rest without forces if ``unloaded``;
        InputError for balls of other kinds.
        """
        network = self.network
        force = network.normal_force
        model = crystal.contact_model
        if network.contact_model is not None:  # which knows the walls of a network that was cut
            walls = dict.fromkeys([*model.walls, *network.contact_model.walls])
            model = replace(model, walls=tuple(walls))
        walls_and_kinds = (*crystal.names, RIGID_PLANE.name, *(wall.name for wall in model.walls))
        kinds = {name: name for name in walls_and_kinds}
        if not network.kinds and len(crystal.names) == 1:
            kinds[_BALL] = crystal.names[0]
        elif not network.kinds or not set(network.kinds) <= set(kinds):
            raise InputError(
                "the balls of the network are not of the kinds of the crystal", mend="Give a law"
            )

        def find_pair(name: str, other: str) -> tuple[Any, Any, Any]:
            return model.law_of(kinds[name], kinds[other])

        groups = list[tuple[Any, Index]]()
        modulus = np.ones(force.size)
        for pair, contacts in self._group(network.i, network.j).items():
            law, _, modulus[contacts] = find_pair(*pair)
            groups.append((law, contacts))
        laws = ContactLaws(groups, force.size, modulus)
        overlap = laws.overlap(np.zeros_like(force) if unloaded else force)
        return _Laws(_take_laws(laws, overlap), laws, self._find_punch(laws), find_pair)

    def _take_law(self, law: Any) -> _Laws:
        """Return the laws of contacts that all have one ``law``."""
        network = self.network
        force = network.normal_force
        pairs = self._group(network.i, network.j)
        pair_law = law_between(law, RIGID_PLANE, RIGID_PLANE)
        overlap = np.asarray(pair_law.overlap(force), float)
        # E* of the balls is not known: that is taken with which 2 E* a, a being the radius of
        # contact, is the normal stiffness at rest; with E* = 1/2, 2 E* a is a itself
        radius = punch_stiffness(pair_law, overlap, 0.5)
        finite_radius = np.where(radius > 0.0, radius, np.inf)
        modulus = 0.5 * np.asarray(pair_law.stiffness(overlap)) / finite_radius
        laws = ContactLaws([(pair_law, np.arange(force.size))], force.size, modulus)
        punch = self._find_punch(laws)
        eta = network.shear_stiffness / punch

        def find_alike(*pair: str) -> tuple[Any, Any, Any]:
            alike = pairs.get(pair, slice(None))
            return pair_law, np.mean(eta[alike]), np.mean(modulus[alike])

        return _Laws(_take_laws(laws, overlap), laws, punch, find_alike)

    def _take_power(self, law: Any) -> _Laws:
        """Return powers of the overlap with the exponent of a ``law``, whose coefficients follow
        from forces and stiffnesses at rest; InputError for contacts without force.
        """
        network = self.network
        force = network.normal_force
        stiffness = network.normal_stiffness
        pairs = self._group(network.i, network.j)
        eta = network.shear_stiffness / stiffness
        if not np.all(force > 0.0):
            raise InputError(
                f"{np.count_nonzero(force <= 0.0)} of {force.size} contacts have no force",
                "Their overlap is not known",
                "Press the network, leave them out, or give a Crystal",
            )
        exponent = law.exponent if isinstance(law, PowerLaw) else hertz.EXPONENT
        overlap = exponent * force / stiffness
        powers = Powers(exponent, force / overlap**exponent, overlap)
        # Hertz's coefficients go with the root of the radius of contacts, and a power has one
        # whatever the balls
        sizes = np.ones_like(network.radii) if isinstance(law, PowerLaw) else network.radii
        per_root = powers.coefficient / _root_radius(sizes, network.i, network.j)

        def find_alike(*pair: str) -> tuple[Any, Any, Any]:
            """Return the coefficient over the root of the radius, kappa/2E*a, and 1 in place of E*,
            of the contacts of a ``pair`` of kinds; InputError if their coefficients differ.
            """
            alike = pairs.get(pair, slice(None))
            if np.ptp(per_root[alike]) > _ALIKE * np.mean(per_root[alike]):
                raise InputError(
                    f"contacts of {pair} have no law that is known", mend="Give a Crystal"
                )
            return np.mean(per_root[alike]), np.mean(eta[alike]), 1.0

        return _Laws(powers, powers, stiffness, find_alike, sizes)

    def _find_punch(self, laws: ContactLaws) -> Array:
        """Return the stiffnesses 2 E* a (n_c,), N/m, of the contacts under their forces at rest;
        those of normal motion where the ``laws`` know no radii.
        """
        network = self.network
        if laws.know_radii:
            return laws.punch(laws.overlap(network.normal_force))
        return network.normal_stiffness

    def _join_laws(
        self, i: Index, j: Index
    ) -> tuple[Powers | PairLaws, Array, list[tuple[Index, str]]]:
        """Return the laws of the contacts and of pairs (i, j) beside, which just touch, and
        kappa/2E*a of these pairs.

        Pairs without a law do not push: the numbers of their contacts come with what is wrong once
        they meet.
        """
        laws = self._laws.known
        n = self.network.n_contacts
        groups = []
        unknown = list[tuple[Index, str]]()
        overlap = np.append(self.overlap, np.zeros(len(i)))
        ratio = np.zeros(len(i))
        modulus = np.ones(len(i))
        for pair, members in self._group(i, j).items():
            try:
                law, ratio[members], modulus[members] = self._laws.find(*pair)
                groups.append((law, n + members))
            except InputError as error:
                unknown.append((n + members, str(error).rstrip(".")))
        if isinstance(laws, ContactLaws):
            joint_laws = ContactLaws(
                [*laws.groups, *groups], len(overlap), np.append(laws.modulus, modulus)
            )
            return _take_laws(joint_laws, overlap, len(i)), ratio, unknown
        coefficient = np.append(laws.coefficient, np.zeros(len(i)))
        for per_root, members in groups:
            pair_roots = _root_radius(self._laws.sizes, i[members - n], j[members - n])
            coefficient[members] = per_root * pair_roots
        return Powers(laws.exponent, coefficient, overlap), ratio, unknown

    def _group(self, i: Index, j: Index) -> dict[tuple[str, ...], Index]:
        """Return the numbers of the contacts (i, j) of each pair of kinds of balls."""
        is_plane = np.isinf(self.network.radii)
        kinds = self.network.kinds or np.where(is_plane, RIGID_PLANE.name, _BALL)
        names, code = np.unique(kinds, return_inverse=True)
        codes = np.sort(code[[i, j]], axis=0)
        # one whole number for each pair: its codes are the digits
        keys = codes[0] * len(names) + codes[1]
        pairs = {key: divmod(key, len(names)) for key in np.unique(keys).tolist()}
        return {
            (str(names[first]), str(names[second])): np.flatnonzero(keys == key)
            for key, (first, second) in pairs.items()
        }

    def run(
        self,
        duration: float,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        drive: Drive | Sequence[Drive] | None = None,
        *,
        displacements: ArrayLike | None = None,
        rotations: ArrayLike | None = None,
        spins: ArrayLike | None = None,
        frames: int = FRAMES,
        step: float | None = None,
        scheme: Literal["verlet", "midpoint"] = "verlet",
        file: str | os.PathLike[str] | None = None,
        progress: Progress = silent,
    ) -> Motion:
        """Let the balls move for a ``duration``, s.

        Parameters
        ----------
        positions : where the balls start, (n, 3) or (n, d), m; by default those of the network.
            Their ``displacements`` from there, m, keep the digits that positions lose: give one of
            both.
        velocities, rotations, spins : at the start, (n, 3) or (n, d), m/s, rad and rad/s; zero by
            default. Contacts have come to the start without sliding, but for Coulomb's limit.
        drive : a :class:`Drive`, or several.
        frames : number of times that are kept, the start and the end among them.
        step : s, of which a frame has a whole number; by default a sixtieth of the shortest period
            that the stiffest contact and its dashpots allow at the start. The default is halved,
            and the run begins anew, where that period comes to have fewer than 30 steps: as soon as
            a drive presses balls that only touch. A step is cut where a contact whose force jumps
            closes or opens.
        scheme : "verlet", explicit and symplectic, whose sum of energies differs from a constant by
            the square of the step, and wanders where contacts open; or "midpoint", implicit, four
            to six times the work, whose sum of energies is constant to rounding, with losses.
        file : path to which frames are written as they come, for :meth:`Motion.read`; a motion
            there is replaced. It can be read at any time, and after the program was killed.
        progress : is told how many frames are done.

        A run that Ctrl-C stops, one whose balls leave their places by half of their diameter
        (geometry "lattice") or meet others without a known law ("exact"), one of whose drives is no
        finite number at a later time, or one for whose contacts the ``step`` becomes too long, as
        it is given or after ten halvings, ends there with a
        :class:`~granphon.base.errors.StoppedEarlyWarning`, and returns what there is. The step is
        too long, too, where an implicit step has no solution, or a contact whose force jumps opens
        and closes many times in it. Where contacts become wider than the law allows
        (:func:`~granphon.validity`), there is a :class:`~granphon.base.errors.LimitWarning`; and
        where they are more viscous than stiff at all frequencies of the run, from the inverse of
        its duration, as a damping is a time.

        Raises :class:`~granphon.base.errors.InputError` for shapes and numbers that are not
        allowed, more frames than memory holds, a drive of nothing or along which balls do not move,
        a displacement that does not begin at zero, a force on a body that is held, two drives of a
        ball of which one is a displacement, a start that moves a body that is held or that a drive
        displaces, a ``step`` too long for the stiffest contact, more than ten million steps, and
        balls too fast, or contacts too stiff, for double precision; and
        :class:`~granphon.base.errors.OutputError` where ``file`` is something else than a motion,
        or cannot be written.
        """
        length = positive("duration", duration, "s")
        count = whole_number("frames", frames, 2, _MOST_STEPS)
        one_of("scheme", scheme, SCHEMES)
        self._require_frames_memory(count, to_file=file is not None)
        if UNCOMPILED:
            warnings.warn(UNCOMPILED, stacklevel=2)
        if positions is not None:
            if displacements is not None:
                raise InputError("positions and displacements are given", mend="Give one of both")
            displacements = self._find_displacements(positions)
        drives = list(drive) if isinstance(drive, list | tuple) else [drive]
        system = _System(self, [] if drive is None else drives)
        moved = system.read("displacements", displacements)
        speeds = system.read("velocities", velocities)
        x = moved + system.read("rotations", rotations)
        v = speeds + system.read("spins", spins)
        chosen_step, top = self._choose_step(system, x, v, step)
        require_steps(length / chosen_step)  # which may be infinite
        trial_step = min(chosen_step, length / (count - 1))
        least_step = trial_step * 2.0**-_HALVINGS
        least_per_period = _FEWEST_STEPS if step is None else _LEAST_STEPS
        # no motion of the run is slower than the run is long, or faster than contacts are
        for sentence in self.losses.find_warnings(min(1.0 / length, top / (2.0 * math.pi))):
            warnings.warn(f"in the motion {sentence.rstrip('.')}", LimitWarning, stacklevel=2)
        while True:
            steps_per_frame = _count_steps(length, trial_step, count)
            schedule = _Schedule(steps_per_frame, count, least_per_period)
            kept = Frames(self.network, length / (count - 1) / steps_per_frame, file)
            # what leaves the floating range ends the run
            floating = np.errstate(over="ignore", invalid="ignore")
            with kept, single_products(), floating, progress.step("motion", count - 1) as told:
                stopped = _record(system, x, v, schedule, scheme, kept, told)
            is_unstable = stopped in (_TOO_LONG, _UNSOLVED, _RATTLED)
            if is_unstable and step is None and trial_step > least_step:
                trial_step *= 0.5
                continue
            wide = check_limit("contact_radius", system.widest).warning
            if wide is not None:
                sentence = f"in the motion {wide[0].lower()}{wide[1:].rstrip('.')}"
                warnings.warn(sentence, LimitWarning, stacklevel=2)
            if stopped:
                early = StoppedEarlyWarning(
                    f"the motion ends after {kept.last_time:.4g} s of {length:.4g} s: {stopped}"
                )
                early.interrupted = stopped == _CTRL_C
                warnings.warn(early, stacklevel=2)
            return kept.join()

    def _choose_step(
        self, system: _System, x: Array, v: Array, step: float | None
    ) -> tuple[float, float]:
        """Return the step, s, of a run that starts at x with velocities v (size,), and a bound of
        the frequencies of contacts, rad/s; raise :class:`~granphon.base.errors.InputError` if the
        ``step`` that the user gives is too long, and as :meth:`_System.press` and
        :meth:`_System.choose_step` do, whether or not a step is given.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(system.operator.values(v) ** 2, axis=1)
            stiffness = system.press(x, 0.5 * float(np.max(squares, initial=0.0)))
            stable = system.choose_step(stiffness)
            top = system.bound.find(stiffness)
        chosen = stable if step is None else positive("step", step, "s")
        if chosen * _LEAST_STEPS > _STEPS * stable:
            raise InputError(
                f"the step of {chosen:.3g} s is too long for the stiffest contact, or its damping",
                "It would not be stable",
                "Leave step out",
            )
        return chosen, top

    def find_step(self, speed: float = 0.0, force: float = 0.0, displacement: float = 0.0) -> float:
        """Return the step, s, with which :meth:`run` begins by default, from rest, or where the
        heaviest ball has a ``speed``, m/s, zero or above.

        The greatest ``force``, N, and ``displacement``, m, of drives, both zero or above, press
        contacts beyond that, by as much: :meth:`run` does not know them before, and halves its step
        where contacts become much stiffer. It also shortens the step until a frame has a whole
        number of steps.

        Raises :class:`~granphon.base.errors.InputError` for numbers below zero, where no contact is
        pressed at them, and for balls too fast, or contacts too stiff, for double precision.
        """
        speed = not_negative("speed", speed, "m/s")
        force = not_negative("force", force, "N")
        displacement = not_negative("displacement", displacement, "m")
        system = _System(self, [])
        masses = self.network.masses[self.network.moving]
        energy = 0.5 * float(np.max(masses, initial=0.0)) * speed * speed
        at_rest = np.zeros(system.operator.size)
        with np.errstate(over="ignore", invalid="ignore"):
            return system.choose_step(system.press(at_rest, energy, force, displacement))

    def _require_frames_memory(self, count: int, *, to_file: bool) -> None:
        """Raise InputError if ``count`` frames of a motion are more than memory holds; frames that
        go ``to_file`` are not held in memory.
        """
        n_held = 2 if to_file else count
        memory = motion_memory(self.network.n_balls, self.network.n_contacts, n_held)
        frames = f"{count:,} frames of a motion of {self.network.n_balls:,} balls"
        require_memory(frames, memory, "Give fewer frames")

    def _find_displacements(self, positions: ArrayLike) -> Array:
        """Return the displacements of balls at ``positions``, (n, 3) or (n, d), m."""
        places = real_array("positions", positions)
        self._require_shape("positions", places)
        return np.asarray(places - self.network.positions[:, : places.shape[1]])

    def _require_shape(self, name: str, values: Array) -> None:
        """Raise InputError unless ``values`` are finite, (n, 3) or (n, d)."""
        n = self.network.n_balls
        d = self.network.dimension
        mend = f"Give ({n}, 3) finite numbers, one row for each ball"
        if values.shape not in ((n, 3), (n, d)):
            raise InputError(f"{name} has the shape {values.shape}", mend=mend)
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} has a number that is not finite", mend=mend)


def require_steps(count: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for more steps than are made."""
    if count > _MOST_STEPS:
        mend = "Give a shorter duration, fewer frames, a longer step, or less damping"
        raise InputError(
            f"the run takes {count:.3g} steps", f"More than {_MOST_STEPS:.0e} are not made", mend
        )


def _read_gravity(gravity: Any, network: ContactNetwork) -> Array:
    """Return the acceleration (3,) of the balls, m/s2; zero without ``gravity``. InputError for
    another shape, and for a direction along which balls do not move.
    """
    field = np.zeros(3)
    if gravity is None:
        return field
    components = real_array("gravity", gravity)
    is_vector = components.shape in ((network.dimension,), (3,))
    if not is_vector or not np.all(np.isfinite(components)):
        raise InputError(
            f"gravity is {brief(gravity)}", mend=f"Give {network.dimension} finite numbers, m/s2"
        )
    field[: len(components)] = components
    require_moves("gravity", field, network)
    return field


def _count_steps(length: float, step: float, count: int) -> int:
    """Return the number of steps from frame to frame, of at most ``step``, s, of ``count`` frames
    in a ``length``, s. InputError for too many steps, and for steps beyond double precision.
    """
    require_steps(length / step)
    interval = length / (count - 1)
    each = max(1, math.ceil(interval / step * (1.0 - _ROUNDING)))
    require_steps(each * (count - 1))
    if not interval / each >= hertz.LEAST_NORMAL:
        raise InputError(
            f"a step of {length:.3g} s over {count - 1} frames is beyond double precision"
        )
    return each


class _Schedule(NamedTuple):
    """Steps from frame to frame, number of frames, and the least number of steps in the shortest
    period.
    """

    each: int
    frames: int
    least_per_period: float


def _record(
    system: _System,
    x: Array,
    v: Array,
    schedule: _Schedule,
    scheme: str,
    kept: Frames,
    told: Any,
) -> str:
    """Keep the frames of a run from x with velocities v (size,), and return why the run ended
    early; empty if it did not.

    A KeyboardInterrupt before the first frame is raised.
    """
    try:
        for frame in system.integrate(x, v, schedule, scheme, kept):
            if frame:
                told.advance()
    except KeyboardInterrupt:
        if not len(kept):  # it came while loops were compiled, or a file was begun
            raise
        return _CTRL_C
    except _Stop as stop:
        return str(stop)
    return ""


class _Stop(Exception):
    """A run cannot go on."""


_NOTHING = np.zeros(0)
_CTRL_C = "Ctrl-C"
_TOO_LONG = "the step is too long for contacts that have become stiffer"
_UNSOLVED = "an implicit step has no solution: scheme: verlet makes it"
_RATTLED = "a contact whose force jumps opens and closes many times in a step"


class _Laws(NamedTuple):
    """Normal laws of the contacts of a network, and of balls that meet.

    Attributes
    ----------
    normal : of the contacts, as steps take them.
    known : the same laws by their groups; powers where one exponent is given for all contacts.
    punch : (n_c,) stiffnesses 2 E* a of the contacts at rest, N/m; those of normal motion where
        laws know no radii.
    find : function of the names of two kinds of balls, which returns the law of such balls that
        meet, kappa/2E*a and E*, or raises InputError if the law is not known. Where one exponent is
        given for all contacts, the coefficient over the root of the radius takes the place of the
        law, and 1 that of E*.
    sizes : (n,) what takes the place of the radii of balls in coefficients, where one exponent is
        given for all contacts; else empty.
    """

    normal: Powers | PairLaws
    known: Powers | ContactLaws
    punch: Array
    find: Callable[..., tuple[Any, Any, Any]]
    sizes: Array = _NOTHING


def _take_laws(springs: ContactLaws, overlap: Array, apart: int = 0) -> Powers | PairLaws:
    """Return laws as for :class:`PairLaws`, or as powers of one exponent, which are faster, if they
    are.
    """
    exponents = {getattr(law, "exponent", hertz.EXPONENT) for law, _ in springs.groups}
    are_powers = all(isinstance(law, HertzLaw | PowerLaw) for law, _ in springs.groups)
    if len(exponents) > 1 or not are_powers:
        return PairLaws(springs, overlap, apart)
    coefficient = np.zeros(len(overlap))
    for law, contacts in springs.groups:
        coefficient[contacts] = law.coefficient  # type: ignore[attr-defined]  # a power
    return Powers(exponents.pop() if exponents else hertz.EXPONENT, coefficient, overlap)


def _root_radius(radii: Array, i: Index, j: Index) -> Array:
    """Return the root of the radius R of contacts, 1/R = 1/R_i + 1/R_j."""
    return np.asarray(1.0 / np.sqrt(1.0 / radii[i] + 1.0 / radii[j]))


class _Trial(NamedTuple):
    """A step that ends with these ``strokes``, m, and ``lifts``, N, of drives, and with contacts
    ``after``; balls have the mean velocity ``drift`` (size,), and come to ``x`` (size,).

    An implicit one also has its mean acceleration, the energies that slip, twist and roll, and
    dashpots take up, and the forces that resist drives. Arrays are the spare ones of the system:
    the next trial writes over them.
    """

    step: float
    strokes: Array
    lifts: Array
    x: Array
    drift: Array
    after: Moment
    acceleration: Any = None
    spent: float = 0.0
    damped: float = 0.0
    resist: Any = None


@dataclass
class _Energies:
    """Energies of a motion since its start, J.

    Attributes
    ----------
    friction : what slip, twist and roll have taken up, stored or lost.
    damping : what dashpots and drag have taken up.
    work : of drives.
    jumps : what was lost where contacts join and part.
    """

    friction: float = 0.0
    damping: float = 0.0
    work: float = 0.0
    jumps: float = 0.0


def _find_stiffest(normal: Powers | PairLaws, e: Array) -> Array:
    """Return the largest stiffnesses on the way to elongations: normal, and of flat punches as wide
    as the contacts, N/m.
    """
    _, stiffness = normal.press(e)
    if isinstance(normal, PairLaws):
        if normal.know_radii:
            stiffness = np.maximum(stiffness, normal.punch(e, np.empty_like(stiffness)))
        for law, contacts in normal.springs.groups:
            if isinstance(law, TabulatedLaw):
                stiffness[contacts] = law.find_stiffest((normal.overlap - e)[contacts])
    return stiffness


def _read_drives(
    drives: Sequence[Any], network: ContactNetwork
) -> tuple[list[tuple[Index, Array]], list[tuple[Index, Array]]]:
    """Return the balls (k,) and the direction (3,) of each drive that is a displacement, and of
    each that is a force; InputError for drives that :meth:`NonlinearWaves.run` refuses.
    """
    moved = []
    pushed = []
    for drive in drives:
        if not isinstance(drive, Drive) or (drive.displacement is None) == (drive.force is None):
            raise InputError(
                f"drive is {brief(drive)}", mend="Give a Drive with a displacement or a force"
            )
        function = drive.force if drive.displacement is None else drive.displacement
        if not callable(function):
            raise InputError(
                f"what a drive does is {brief(function)}",
                mend="Give a function of the time, s, that returns a number",
            )
        balls = index_array("drive", drive.balls, network.n_balls)
        along = read_vector("direction", drive.direction, network.dimension)
        require_moves("drive", along, network)
        if drive.force is None:
            moved.append((balls, along))
            continue
        if not np.all(network.moving[balls]):
            raise InputError("a force acts on a body that is held", mend="Give its displacement")
        pushed.append((balls, along))
    driven = np.concatenate([balls for balls, _ in moved] or [np.zeros(0, np.intp)])
    is_moved_twice = len(np.unique(driven)) < len(driven)
    if is_moved_twice or any(np.any(np.isin(balls, driven)) for balls, _ in pushed):
        raise InputError(
            "a ball has two drives, of which one is a displacement",
            "It moves as that says, whatever acts on it",
            "Give it one drive",
        )
    return moved, pushed


class _RateBound:
    """A bound of the angular frequencies of the contacts of a network, whose other stiffnesses are
    in proportion to ``punch`` (n_c,), those of flat punches as wide as the contacts.
    """

    def __init__(self, operator: WaveOperator, punch: Array) -> None:
        rows = operator.law_rows
        self._ratios = [row.stiffness / punch for row in rows[1:]]
        slip = operator.network.shear_stiffness / punch
        self._per_slip = np.divide(1.0, slip, out=np.zeros_like(slip), where=slip > 0.0)
        self._count = operator.network.n_contacts
        deform = abs(operator.compose(rows))
        self._pull = deform.T.tocsr()
        self._largest = deform @ np.ones(operator.size)
        self._anchors = operator.anchors

    def find(self, stiffness: Array) -> float:
        """Return the bound, rad/s, of contacts of a normal ``stiffness`` (n_c,), N/m, those of the
        network first; others may be at any ball, so that each contact of the network counts as
        stiff as the stiffest of them, or more.
        """
        stiffness = self._count_stiffest(stiffness)
        return math.sqrt(np.max(self._bound(stiffness, stiffness) + self._anchors))

    def find_viscous(self, stiffness: Array, losses: Losses) -> float:
        """Return a bound of the rates, 1/s, of all ``losses``, of contacts of a normal
        ``stiffness`` (n_c,) as for :meth:`find`.
        """
        stiffness = self._count_stiffest(stiffness)
        none = np.zeros(0, np.intp)
        *_, normal, side, root = losses.list_dashpots(none, none)
        of_root = root * np.sqrt(stiffness)
        in_proportion = np.max(losses.damping) * self._bound(stiffness, stiffness)
        viscous = self._bound(normal + of_root, (side + of_root) * self._per_slip)
        return float(np.max(in_proportion) + np.max(viscous) + np.max(losses.drag))

    def _count_stiffest(self, stiffness: Array) -> Array:
        """Return the stiffness (n_c,) of contacts of the network, at least that of the others."""
        count = self._count
        if len(stiffness) > count:  # balls have met
            return np.asarray(np.maximum(stiffness[:count], stiffness[count:].max()))
        return stiffness

    def _bound(self, normal: Array, side: Array) -> Array:
        """Return sums (size,) of the sizes of each row of A^T W A, the largest of which bounds its
        eigenvalues, where W has the weights ``normal`` (n_c,) of elongations, and the ratios of
        other deformations times ``side`` (n_c,).
        """
        weights = np.concatenate([normal, *(ratio * side for ratio in self._ratios)])
        return np.asarray(self._pull @ (weights * self._largest))


class _System:
    """The equations of motion of a network with drives, and where it has come to.

    ``at`` are contacts now, and ``joined`` says which of them are, None where no force jumps.
    These and what follows are set when a run begins.
    """

    at: Moment
    joined: Any
    strokes: Array
    lifts: Array
    energies: _Energies
    #: where balls were when those that may meet were listed, and how far one may have gone since, m
    _listed: Array
    _travelled: float

    def __init__(self, waves: NonlinearWaves, drives: Sequence[Any]) -> None:
        network = waves.network
        self.waves = waves
        self.drives = drives
        self.moved, pushed = _read_drives(drives, network)
        masses = network.masses.copy()
        for balls, _ in self.moved:
            masses[balls] = np.inf
        self.network = replace(network, masses=masses) if self.moved else network
        operator = WaveOperator(self.network)
        self.operator = operator
        axes = list(operator.motions.translations)
        self._along = [(balls, along[axes]) for balls, along in self.moved]
        self.bound = _RateBound(operator, waves.punch)
        # where each motion of a vector is among those of all balls (n, m), and over the
        # mass-weighted one
        indices = operator.indices
        self._places = np.flatnonzero(indices.ravel() >= 0)
        _, self._scale = operator.flat_indices_and_scale
        self._strokes = [drive.displacement for drive in drives if drive.displacement is not None]
        self._lifts = [drive.force for drive in drives if drive.force is not None]
        pushes = [operator.push(*push, 1.0 / np.sqrt(masses[push[0]])) for push in pushed]
        self._push = np.reshape(pushes, (-1, operator.size))
        self._weight = operator.push(operator.balls, waves.gravity, np.sqrt(masses[operator.balls]))
        self._drag = operator.drag(waves.losses)
        self._has_drag = bool(np.any(self._drag))
        self._lightest = math.sqrt(float(np.min(masses[self.network.moving], initial=np.inf)))
        # balls that may meet are listed anew when one has moved by half of the margin
        self._skin = _SKIN * 2.0 * float(np.mean(self.network.radii[self.network.moving]))

    def _join(self, i: Index, j: Index, shift: Index) -> None:
        """Let contacts be those of the network and, behind them, those of the pairs (i, j, shift);
        contacts without a law end the run when they close.

        The scheme must be known. The state of contacts is to be set anew: see :meth:`_begin` and
        :meth:`_carry_over`.
        """
        waves = self.waves
        law = waves.normal
        ratio = np.zeros(0)
        self._unknown: list[tuple[Index, str]] = []
        radii = self.network.radii
        ends = np.append(self.network.i, i), np.append(self.network.j, j)
        # Hertz's radius of a contact over that of the smaller ball, over the root of the overlap
        self._wide = _root_radius(radii, *ends) / np.minimum(*(radii[end] for end in ends))
        if len(i):
            law, ratio, self._unknown = waves._join_laws(i, j)
        pairs = MetPairs(i, j, shift, ratio, self._bulge if waves.rules.turns else 0.0)
        self.contacts = MovingContacts(
            self.network, pairs, law, waves.punch, waves.losses, waves.rules
        )
        load = -self._accelerate(self.contacts.still, np.zeros(self.operator.size))
        self._steady: Array = load + self._weight
        self._knows_law = self.contacts.knows_law and self._explicit and not self._unknown

    def _accelerate(self, forces: Array, steady: Array) -> Array:
        """Return the accelerations (size,) by forces on balls (n, m), and ``steady`` ones."""
        acceleration = np.empty(self.operator.size)
        gather(forces, self._places, self._scale, steady, acceleration)
        return acceleration

    def _spread(self, x: Array, strokes: Array, motions: Array) -> None:
        """Set the motions (n, m) of all balls."""
        spread(x, self._places, self._scale, motions)
        for (balls, along), stroke in zip(self._along, strokes, strict=True):
            motions[balls, : len(along)] = stroke * along

    @property
    def _bulge(self) -> float:
        """Overlap at rest less the one that radii and places of the network have, m: a mean."""
        network = self.network
        round_ones = np.flatnonzero(np.isfinite(self.network.distance))
        i = network.i[round_ones]
        j = network.j[round_ones]
        apart = network.distance[round_ones] - network.radii[i] - network.radii[j]
        return float(np.mean(self.waves.overlap[round_ones] + apart)) if len(i) else 0.0

    def read(self, name: str, given: ArrayLike | None) -> Array:
        """Return vectors of balls (n, 3) or (n, d), by the ``name`` of the argument, as
        mass-weighted motions (size,); zero if none are given.

        InputError for another shape, and for vectors that are not finite, along which balls do not
        move or turn, or of a ball that is held or that a drive displaces.
        """
        operator = self.operator
        network = self.network
        if given is None:
            return np.zeros(operator.size)
        values = real_array(name, given)
        self.waves._require_shape(name, values)
        turns = name in ("rotations", "spins")
        axes = operator.motions.rotations if turns else operator.motions.translations
        if values.shape[1] <= max(axes, default=0):
            raise InputError(
                f"{name} has the shape {values.shape}", mend=f"Give ({network.n_balls}, 3)"
            )
        values = np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
        require_moves(name, values, network, turns)
        is_wrong = np.any(values, axis=1) & ~network.moving
        if np.any(is_wrong):
            raise InputError(
                f"{name} of ball {np.flatnonzero(is_wrong)[0]} are not zero",
                "It is held, or is displaced by a drive, whatever acts on it",
                "Let them be zero",
            )
        places, scale = operator.flat_indices_and_scale
        return np.asarray(
            np.pad(values, ((0, 0), (3 * turns, 3 - 3 * turns))).ravel()[places] / scale
        )

    def choose_step(self, stiffness: Array) -> float:
        """Return a step, s, for contacts of a normal ``stiffness`` (n_c,), N/m; InputError for
        contacts too stiff for double precision, and where none is pressed.
        """
        top = self._top(stiffness)
        if not top < math.inf:
            raise InputError(
                "contacts become too stiff for double precision", mend="Compare the units"
            )
        if not top > 0.0:
            raise InputError(
                "no contact is pressed, and no ball moves", "There is no time scale", "Give a step"
            )
        return 2.0 * math.pi / _STEPS / top

    def press(
        self, x: Array, energy: float, force: float = 0.0, displacement: float = 0.0
    ) -> Array:
        """Return the stiffness (n_c,), N/m, of each contact of the network, or of a flat punch as
        wide if that is stiffer, at the start x (size,), or where a ball of this kinetic ``energy``,
        J, a ``force``, N, or a ``displacement``, m, would press it if that is deeper.

        Under gravity it is at least that at rest. InputError for balls too fast, or too far away,
        for double precision.
        """
        normal = self.waves.normal
        motions = np.zeros(self.operator.indices.shape)
        self._spread(x, np.zeros(len(self.moved)), motions)
        e = measure_along(self.network, motions)
        if not (energy < math.inf and np.all(np.isfinite(e))):
            raise InputError(
                "balls are too fast, or too far away, for double precision",
                mend="Compare the units",
            )
        # the first of these depths that takes the energy and bears the force, by bisection
        mean_radius = float(np.mean(self.network.radii[self.network.moving]))
        depths = _LEAST_DEPTH * mean_radius * _DEPTH_RATIO ** np.arange(float(_N_DEPTHS))
        low = np.zeros(len(e), np.int16)
        is_pressed = energy > 0.0 or force > 0.0
        high = np.full(len(e), _N_DEPTHS - 1 if is_pressed else 0, np.int16)
        while np.any(low < high):
            middle = (low + high) // 2
            depth = depths[middle]
            is_shallow = normal.store(-depth) + normal.rest * depth < energy
            is_shallow |= normal.press(-depth)[0] < force
            low = np.where(is_shallow, middle + 1, low)
            high = np.where(is_shallow, high, middle)
        depth = np.maximum(depths[low], displacement)
        stiffness = _find_stiffest(normal, np.minimum(-depth, e))
        if np.any(self.waves.gravity):  # what a ball of this network falls by its own size presses
            stiffness = np.maximum(stiffness, self.network.normal_stiffness)
        return stiffness

    def _top(self, stiffness: Array) -> float:
        """Return a bound of the rates, rad/s, of contacts of a normal ``stiffness``: of oscillation
        w and of losses.

        Dashpots slow motions down at the rate g = tau w^2, or c/m. Steps h are stable for g h < 1,
        and for w h < 2.
        """
        return max(
            self.bound.find(stiffness), 2.0 * self.bound.find_viscous(stiffness, self.waves.losses)
        )

    def integrate(self, x: Array, v: Array, schedule: _Schedule, scheme: str, kept: Frames) -> Any:
        """Keep the frames of a run from x with velocities v (size,), and yield after each whether
        steps led to it: False for the first, which is the start.

        Raises :class:`_Stop` where the run cannot go on, and InputError as :meth:`_begin` does.
        """
        explicit = scheme == "verlet"
        step = kept.step
        each = schedule.each
        self._begin(x, v, step, explicit)
        self._keep(0, kept)
        yield False
        limit = 2.0 * math.pi / schedule.least_per_period / step
        allowed = self._find_allowed(limit)
        for number in range(1, each * (schedule.frames - 1) + 1):
            if self.waves.geometry == "exact":
                self._watch(self._evaluate_drives(number * step)[0])
            self._advance(number * step, explicit)
            is_frame = number % each == 0
            # most steps need no look at all contacts: none is stiff enough
            if is_frame or self.contacts.stiffest > allowed:
                self._refresh()
                self._require_short(limit)
            if is_frame:
                self._keep(number, kept)
                yield True
                if self.waves.geometry == "lattice":
                    self._require_places()

    def _find_allowed(self, limit: float) -> float:
        """Return a stiffness, N/m, with which all contacts keep the bound of all rates below the
        ``limit``, rad/s: to 1 % the greatest one; zero if none does.
        """
        ones = np.ones(self.network.n_contacts)
        place = bisect_right(_STIFFNESSES, limit, key=lambda k: self._top(k * ones))
        return float(_STIFFNESSES[place - 1]) if place else 0.0

    def _require_short(self, limit: float) -> None:
        """Raise :class:`_Stop` unless the rates of contacts, which :meth:`_refresh` has set, are
        below the ``limit``, rad/s, and motions are finite.
        """
        stiffest = np.maximum(self.at.k, self.at.punch)
        is_finite = np.all(np.isfinite(self.v)) and np.all(np.isfinite(self.at.e))
        if not (self._top(stiffest) <= limit and is_finite):
            raise _Stop(_TOO_LONG)

    def _require_places(self) -> None:
        """Raise :class:`_Stop` if a ball has left its place."""
        away = float(np.max(np.abs(self.operator.to_balls(self.x)[:, :3]), initial=0.0))
        if not away < _AWAY * 2.0 * float(np.mean(self.network.radii[self.network.moving])):
            raise _Stop(f"a ball has left its place by {away:.3g} m, which needs geometry: exact")

    def _begin(self, x: Array, v: Array, step: float, explicit: bool) -> None:
        """Begin a run of a ``step``, s, at the time zero, from motions x with velocities v (size,),
        of which copies are kept.

        Contacts come from rest to the start as :meth:`MovingContacts.begin` says. InputError for a
        drive whose displacement is not zero at the time zero, or that is no finite number then.
        """
        self._explicit = explicit  # first: what contacts set in a step depends on the scheme
        none = np.zeros(0, np.intp)
        self._keys: dict[tuple[int, ...], int] = {}
        self._join(none, none, np.zeros((0, 3), np.intp))
        self.x = x.copy()
        self.v = v.copy()
        self.step = step
        self.widest = 0.0
        self.strokes, self.lifts = self._evaluate_drives(0.0)
        if np.any(self.strokes):
            raise InputError(
                "a displacement does not begin at zero", mend="Give a function that is zero at zero"
            )
        contacts = self.contacts
        at_rest = contacts.make_moment()
        contacts.press(at_rest, None)
        self._shear_energy_at_rest = contacts.shear_energy(at_rest)
        self.at = contacts.make_moment()
        self._spread(self.x, self.strokes, self.at.motions)
        self.joined = contacts.begin(self.at)
        self._make_spare()
        # balls that may meet are listed behind the contacts of the network, which keep the state
        # that they have by now; what follows is of all contacts
        if self.waves.geometry == "exact":
            self._list()
        self._shear_energy_at_start = self.contacts.shear_energy(self.at)
        self.energies = _Energies()
        # the speeds of drives follow from their displacements in the last step: there is none yet
        self._start(np.zeros_like(self.strokes))

    def _make_spare(self) -> None:
        """Make arrays for a step."""
        self._spare = self.contacts.make_spare(self.at, has_pull=not self._explicit)
        self._spare_x = np.empty_like(self.x)
        self._spare_v = np.empty_like(self.x)
        self._speeds = np.zeros_like(self.at.motions)

    def _start(self, speeds: Array) -> None:
        """Set what a step begins with, at these speeds of the drives."""
        self._spread(self.v, speeds, self._speeds)
        self.contacts.act(self.at, self._speeds)
        self.acceleration = self._accelerate(self.contacts.on_balls, self._steady_push(self.lifts))
        if self._has_drag:
            self.acceleration -= self._drag * self.v
        self.resist = self._find_resistance()
        self.last = self.acceleration

    def _steady_push(self, lifts: Array) -> Array:
        """Return the accelerations (size,) by loads, weights and the forces ``lifts`` of drives."""
        return self._steady + lifts @ self._push if len(lifts) else self._steady

    def _find_resistance(self) -> Array:
        """Return the forces with which contacts and loads resist displacements of drives."""
        forces = self.contacts.still - self.contacts.on_balls if self._along else _NOTHING
        resistances = [np.sum(forces[balls, : len(along)] @ along) for balls, along in self._along]
        return np.array(resistances)

    def _refresh(self) -> None:
        """Set elongations, normal forces and stiffnesses, which steps do not set whose loops know
        the law.
        """
        if self._knows_law:
            self.contacts.measure(self.at)
            self.contacts.press(self.at, self.joined)

    def _advance(self, end: float, explicit: bool) -> None:
        """Make a step that ends at the time ``end``, s, in parts where contacts join or part within
        it; :class:`_Stop` where one does so too often, and as :meth:`_try_step` raises it.
        """
        remaining = self.step
        has_jumps = len(self.contacts.law.jumps) > 0
        often: Index = np.zeros(len(self.at.e) if has_jumps else 0, np.intp)
        while remaining > 0.0:
            trial = self._try_step(remaining, end, explicit)
            if has_jumps and self._find_overshoot(trial.after) > 0.0:
                trial = self._cut(trial, end, explicit)
            speeds = (trial.strokes - self.strokes) / trial.step
            last_moment = self.at
            if len(trial.lifts):
                mean_lifts = 0.5 * (self.lifts + trial.lifts)
                moved = trial.step * (self._push @ trial.drift)
                self.energies.work += float(mean_lifts @ moved)
            if explicit:
                self._leap(trial, speeds)
            else:
                self._settle(trial)
            self._spare = last_moment
            self.strokes = trial.strokes
            self.lifts = trial.lifts
            remaining -= trial.step
            if has_jumps and self._find_overshoot(self.at) > 0.0:
                self.joined, switched, loss = self.contacts.switch(self.at, self.joined)
                self.energies.jumps += loss
                self._start(speeds)
                often[switched] += 1
                if np.max(often) > _RATTLES:
                    raise _Stop(_RATTLED)

    def _find_overshoot(self, moment: Moment) -> float:
        """Return how far the first of the contacts has passed where it joins or parts, m; below
        zero before it.
        """
        return float(np.max(self.contacts.pass_ends(moment.e, self.joined)))

    def _cut(self, trial: _Trial, end: float, explicit: bool) -> _Trial:
        """Return the part of a step in which the first contacts come to where they join or part.

        It is found by the rule of false position (the Illinois method), to a small share of the
        step. The ``trial`` of the whole step may not be used after that.
        """
        whole = trial.step
        start = end - trial.step
        low = 0.0
        high = whole
        side = 0
        low_overshoot = self._find_overshoot(self.at)
        high_overshoot = self._find_overshoot(trial.after)
        near = _TOGETHER * self.step
        while high - low > near:
            middle = low - low_overshoot * (high - low) / (high_overshoot - low_overshoot)
            middle = min(max(middle, low + 0.5 * near), high - 0.5 * near)
            trial_to_middle = self._try_step(middle, start + middle, explicit)
            passed = self._find_overshoot(trial_to_middle.after)
            if passed > 0.0:
                high = middle
                high_overshoot = passed
                low_overshoot *= 0.5 if side == 1 else 1.0
                side = 1
            else:
                low = middle
                low_overshoot = passed
                high_overshoot *= 0.5 if side == -1 else 1.0
                side = -1
        # tried again, as the arrays are those of the last trial
        return (
            self._try_step(whole, end, explicit)
            if whole - high < near
            else self._try_step(high, start + high, explicit)
        )

    def _try_step(self, step: float, end: float, explicit: bool) -> _Trial:
        """Return the trial of a ``step``, s, that ends at the time ``end``, s: by Verlet's scheme
        if ``explicit``, else by the implicit one.

        The next trial overwrites its arrays. Raises :class:`_Stop` if the implicit step has no
        solution, or a drive is no finite number at ``end``.
        """
        strokes, lifts = self._evaluate_drives(end)
        if not explicit:
            return self._solve(step, strokes, lifts)
        moment = self._drift(step, strokes, self.acceleration)
        return _Trial(step, strokes, lifts, self._spare_x, self._spare_v, moment)

    def _drift(self, step: float, strokes: Array, acceleration: Array) -> Moment:
        """Move balls through a ``step``, s, with a constant ``acceleration`` (size,), and bodies
        to ``strokes``, in spare arrays. Return the contacts there: the motions of balls, and
        elongations unless the loops know the law.
        """
        moment = self._spare
        drift(self.x, self.v, acceleration, step, self._spare_x, self._spare_v)
        self._spread(self._spare_x, strokes, moment.motions)
        if not self._knows_law:
            self.contacts.measure(moment)
        return moment

    def _leap(self, trial: _Trial, speeds: Array) -> None:
        """Make the step of Verlet's that has been tried last, with drives at these ``speeds``."""
        contacts = self.contacts
        start = self.at
        end = trial.after
        half = 0.5 * trial.step
        self.x, self._spare_x = trial.x, self.x
        self.v, self._spare_v = trial.drift, self.v
        if contacts.is_damped:
            # the speed at the end of the step, but for what dashpots change within it
            end_speed = self.v + half * self.acceleration
            self._spread(end_speed, speeds, self._speeds)
        if not self._knows_law:
            contacts.press(end, self.joined)
        spent, damped = contacts.follow(start, end, self._knows_law, self._speeds)
        self.at = end
        self.energies.friction += spent
        self.energies.damping += damped
        steady = self._steady_push(trial.lifts)
        gather(contacts.on_balls, self._places, self._scale, steady, self.acceleration)
        if self._has_drag:
            self.energies.damping += trial.step * float(self._drag @ self.v**2)
            self._slow_down(self.acceleration, self.v, half)
        resist = self._find_resistance()
        mean_resistance = 0.5 * (self.resist + resist)
        self.energies.work += float(mean_resistance @ (trial.strokes - self.strokes))
        self.resist = resist
        kick(self.v, self.acceleration, half)

    def _solve(self, step: float, strokes: Array, lifts: Array) -> _Trial:
        """Return where an implicit ``step``, s, whose energies add up, comes to, in spare arrays,
        with drives at the ``strokes`` and forces ``lifts`` at its end; :class:`_Stop` if
        the iteration does not converge.
        """
        contacts = self.contacts
        steady = self._steady_push(0.5 * (self.lifts + lifts))
        guess = 2.0 * self.acceleration - self.last
        change = math.inf
        for _ in range(_ITERATIONS):
            moment = self._drift(step, strokes, guess)
            contacts.press(moment, self.joined)
            spent, damped = contacts.follow_mean(self.at, moment, self.joined, step)
            acceleration = self._accelerate(contacts.on_balls, steady)
            if self._has_drag:
                damped += step * float(self._drag @ self._spare_v**2)
                self._slow_down(acceleration, self.v, 0.5 * step)
            last = change
            change = float(np.max(np.abs(acceleration - guess)))
            size = max(float(np.max(np.abs(acceleration))), float(np.max(np.abs(self.v))) / step)
            only_rounds = last <= change <= _ROUNDED * size  # it no longer gets nearer
            if change <= _SOLVED * size or only_rounds:
                resist = self._find_resistance()
                x = self._spare_x
                return _Trial(
                    step=step,
                    strokes=strokes,
                    lifts=lifts,
                    x=x,
                    drift=self._spare_v,
                    after=moment,
                    acceleration=guess,
                    spent=spent,
                    damped=damped,
                    resist=resist,
                )
            guess = acceleration
        raise _Stop(_UNSOLVED)

    def _slow_down(self, acceleration: Array, v: Array, span: float) -> None:
        """Add drag to an ``acceleration`` (size,): that of the velocity to which balls with the
        velocity ``v`` (size,) come in a ``span``, s.
        """
        acceleration -= self._drag * (v + span * acceleration) / (1.0 + span * self._drag)

    def _settle(self, trial: _Trial) -> None:
        """Make the implicit step that has been solved last."""
        self.last = self.acceleration
        self.acceleration = trial.acceleration
        self.at = trial.after
        self.x, self._spare_x = trial.x, self.x
        kick(self.v, trial.acceleration, trial.step)
        self.energies.friction += trial.spent
        self.energies.damping += trial.damped
        self.energies.work += float(trial.resist @ (trial.strokes - self.strokes))

    def _keep(self, number: int, kept: Frames) -> None:
        """Keep the frame after this ``number`` of steps, and how wide the widest contact has become
        in all frames.

        Elongations and normal forces must be those of the moment, see :meth:`_refresh`.
        """
        moment = self.at
        contacts = self.contacts
        joined = self.joined
        normal = contacts.law
        step = self.step
        operator = self.operator
        square = self.v * self.v
        shear_energy = contacts.shear_energy(moment)
        stored = (
            float(np.sum(normal.store(moment.e, joined)))
            + shear_energy
            - self._shear_energy_at_rest
            - float(self._weight @ self.x)
        )
        # of what slip takes up, contacts still store a part
        friction_loss = self.energies.friction - (shear_energy - self._shear_energy_at_start)
        wide = self._wide * np.sqrt(np.maximum(normal.overlap - moment.e, 0.0))
        self.widest = max(self.widest, float(np.max(wide, initial=0.0)))
        time = number * step
        displacements, rotations = np.split(self._displace(), 2, axis=1)
        speeds, spins = np.split(operator.to_balls(self.v), 2, axis=1)
        if self._strokes:
            drive_speeds = self._find_drive_speeds(number)
            for (balls, along), speed in zip(self.moved, drive_speeds, strict=True):
                speeds[balls] = speed * along
        kept.keep(
            {
                "times": time,
                "displacements": displacements,
                "velocities": speeds,
                "rotations": rotations,
                "spins": spins,
                "translation": 0.5 * float(np.sum(square[~operator.is_rotation])),
                "rotation": 0.5 * float(np.sum(square[operator.is_rotation])),
                "stored": stored + contacts.rest_energy(moment),
                "lost": friction_loss + self.energies.damping + self.energies.jumps,
                "work": self.energies.work,
            },
            np.where(normal.is_closed(moment.e, joined), moment.pull[0] + normal.rest, 0.0),
            contacts.shears(moment),
            list(self._keys),
        )

    def _find_drive_speeds(self, number: int) -> Array:
        """Return the speeds, m/s, of driven bodies after this ``number`` of steps: central
        differences over two steps.

        Differences are one-sided at the start, and where a drive is no finite number one step
        later: it may end with the run.
        """
        time = number * self.step
        start, _ = self._evaluate_drives(max(time - self.step, 0.0))
        n_steps = 2 if number else 1
        try:
            end, _ = self._evaluate_drives(time + self.step)
        except _Stop:
            end = self.strokes  # those now
            n_steps = 1
        return (end - start) / (n_steps * self.step)

    def _evaluate_drives(self, time: float) -> tuple[Array, Array]:
        """Return the strokes, m, of moved bodies and the forces, N, on pushed balls at a time, s.

        Where one is not finite the run stops, or at the time zero there is an InputError.
        """
        if not self.drives:
            return _NOTHING, _NOTHING
        strokes = np.array([real_number(displacement(time)) for displacement in self._strokes])
        lifts = np.array([real_number(force(time)) for force in self._lifts])
        if not (np.all(np.isfinite(strokes)) and np.all(np.isfinite(lifts))):
            fault = f"a drive is not a finite number at {time:.4g} s"
            if time:
                raise _Stop(fault)
            raise InputError(fault, mend="Give a function of the time that returns one")
        return strokes, lifts

    def _displace(self) -> Array:
        """Return displacements, m, and rotations, rad, (n, 6) of all balls and bodies."""
        motions = self.operator.to_balls(self.x)
        for (balls, along), stroke in zip(self.moved, self.strokes, strict=True):
            motions[balls, :3] = stroke * along
        return motions

    def _watch(self, strokes: Array) -> None:
        """List anew the balls that may meet, if one may move in a step to ``strokes`` by more than
        half of the margin.

        Ends the run where balls without a law have met.
        """
        from scipy.linalg.blas import idamax

        for contacts, reason in self._unknown:
            if np.any(self.at.e[contacts] < 0.0):
                raise _Stop(reason)
        # no ball is faster
        speed = math.sqrt(3.0) * abs(float(self.v[idamax(self.v)])) / self._lightest
        self._travelled += self.step * speed + (
            float(np.max(np.abs(strokes - self.strokes))) if len(strokes) else 0.0
        )
        if self._travelled > 0.5 * self._skin:
            gone = self.network.positions + self._displace()[:, :3] - self._listed
            self._travelled = math.sqrt(np.max(np.sum(gone * gone, axis=1)))
            if self._travelled > 0.45 * self._skin:
                self._list()

    def _list(self) -> None:
        """List the balls that may meet; contacts that are listed again keep their state."""
        self._travelled = 0.0
        self._listed = self.network.positions + self._displace()[:, :3]
        table = self._find_pairs(self._listed)
        n = self.network.n_contacts
        keys = [tuple(key) for key in table.tolist()]
        if set(keys) == set(self._keys):
            return
        numbers = np.array([self._keys.get(key, -1) for key in keys], np.intp)
        self._keys = {key: n + place for place, key in enumerate(keys)}
        dash = self.contacts.dash
        self._join(table[:, 0], table[:, 1], table[:, 2:])
        self._carry_over(np.flatnonzero(numbers >= 0), numbers[numbers >= 0], dash)

    def _find_pairs(self, places: Array) -> Index:
        """Return the pairs (i, j, shift) (n_p, 5) of balls at ``places`` (n, 3), m, or of a ball i
        and a flat wall j, that may meet, each once. Contacts of the network, and pairs of two
        bodies that are held, are not among them.
        """
        network = self.network
        radii = network.radii
        round_ones = np.flatnonzero(np.isfinite(radii))
        periods = network.cell[list(network.pbc)]
        margin = self._skin + max(self._bulge, 0.0)
        i, j, cells, apart = find_pairs(
            places[round_ones], periods, 2.0 * float(np.max(radii[round_ones])) + margin
        )
        near = np.linalg.norm(apart, axis=1) < radii[round_ones[i]] + radii[round_ones[j]] + margin
        i = round_ones[i[near]]
        j = round_ones[j[near]]
        shift = np.zeros((np.count_nonzero(near), 3), np.intp)
        shift[:, list(network.pbc)] = cells[near]
        for wall, (place, toward) in network.walls.items():
            moved = places[wall] - network.positions[wall]
            gap = (place + moved - places[round_ones]) @ toward - radii[round_ones]
            balls = round_ones[gap < self._skin]
            i = np.append(i, balls)
            j = np.append(j, np.full(len(balls), wall))
            shift = np.concatenate([shift, np.zeros((len(balls), 3), np.intp)])
        # contacts begin with the ball that pairs begin with, and those with a flat wall, which is
        # at any place, with the other
        flat = np.isinf(network.distance)
        contacts = np.column_stack(
            [network.i, network.j, np.where(flat[:, None], 0, network.shift)]
        )
        is_reversed = ~(select_once(network.i, network.j, network.shift) | flat)
        reverse = np.column_stack([network.j, network.i, -network.shift])
        contacts[is_reversed] = reverse[is_reversed]
        pairs = np.column_stack([i, j, shift])[network.moving[i] | network.moving[j]]
        table, first = np.unique(np.concatenate([contacts, pairs]), axis=0, return_index=True)
        return np.asarray(table[first >= network.n_contacts])

    def _carry_over(self, listed: Index, numbers: Index, dash: Array) -> None:
        """Let contacts that have been listed anew keep their state: those of the network, and the
        pairs ``listed``, numbered from zero, whose contacts had the ``numbers`` until now.

        ``dash`` are the forces of dashpots until now: :meth:`_join` has made new contacts since.
        """
        contacts = self.contacts
        n = self.network.n_contacts
        old = self.at
        old_joined = self.joined
        self.at = contacts.make_moment()
        self.at.motions[:] = old.motions
        contacts.measure(self.at)
        joined = contacts.law.begin(self.at.e)
        if joined is not None and old_joined is not None:
            joined[:n] = old_joined[:n]
            joined[n + listed] = old_joined[numbers]
        self.joined = joined
        pairs = [(self.at.pull, old.pull)]
        if contacts.is_damped:
            pairs.append((contacts.dash, dash))
        for rows, old_rows in pairs:
            rows[:] = 0.0
            rows[:, :n] = old_rows[:, :n]
            rows[:, n + listed] = old_rows[:, numbers]
        contacts.press(self.at, joined)
        self._make_spare()
