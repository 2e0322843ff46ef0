"""Balls of a network that move by the whole of the law of their contacts, in time.

Mass-weighted motions x = M^1/2 u obey (of rotations phi, u is w = R_g phi with the radius of
gyration R_g)

    x'' = A^T ((f(h) - f_0) e_n - (T - T_0)) - Gamma x' + forces,    A = C M^-1/2

where A x are the deformations of contacts, h their overlaps, e_n the rows of elongation, and f and
T the normal force and the force of slip of a contact (:mod:`granphon.contacts.motion`). f_0 and T_0
are the static forces, which the load holds in balance. Contacts are measured in the directions that
they have in the network, where displacements are small against the balls but not against the
overlaps, or in their true directions.

There are two schemes.

- "verlet": steps in velocity form are explicit, symplectic and, without losses, the same backwards.
  The sum of energies, each known in closed form, differs from a constant by the square of the step.
  The difference wanders where contacts open, as the force has no second derivative there. The drag
  Gamma x' is that of the velocity at the end of a step, which follows in closed form.
- "midpoint": steps take the velocity and the geometry at the middle of the step, and a mean force
  of each contact. The mean normal force is the change of the energy over that of the overlap, other
  mean forces are those of both ends of the step. So the work of forces is the change of
  energies (the discrete gradient of D. Greenspan, Discrete Models, 1973, and O. Gonzalez, J.
  Nonlinear Sci. 6, 449, 1996), and the sum of energies is constant to rounding, with losses too.
  These steps are implicit, and solved by iteration.

The force of some contacts jumps, as that of balls that adhere when they touch or part. There a step
ends, and the next step begins with the other force: so both schemes stay of second order. A contact
jumps at the instant at which it comes to the overlap of the jump on the path of the step.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
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
from granphon.base.compiled import find_why_uncompiled
from granphon.base.errors import InputError, LimitWarning, StoppedEarlyWarning, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, silent
from granphon.base.text import counted
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
from granphon.dynamics.damping import GivenLosses, Losses
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

#: steps in the shortest period that the contacts could have at the start: as a run chooses them,
#: and the fewest with which steps are stable
_STEPS_PER_PERIOD = 60.0
_LEAST_STABLE_STEPS = 4.0
#: fewest steps in the shortest period at any later time, if the run has chosen the step
_LEAST_CHOSEN_STEPS = 30.0
#: the depth to which a ball presses a contact is sought among depths that grow by a ratio: the
#: least depth, over the mean radius; the ratio, with which the stiffness of Hertz's law rises by an
#: eighth; and the number of depths, of which the last is far above any that occurs
_LEAST_DEPTH = 1e-12
_DEPTH_RATIO = 1.25
_N_DEPTHS = 201
#: share of a step that is rounding, when the time from frame to frame is divided into steps
_ROUNDING = 1e-12
#: most times that a step that is too long is halved, and the run begun anew
_MOST_HALVINGS = 10
#: most steps of a run
_MOST_STEPS = 10_000_000
#: displacement, over the mean diameter, at which a run with geometry "lattice" ends, as a ball has
#: left its place
_MOST_DISPLACEMENT = 0.5
#: kind of the balls of a network that names none
_BALL = "ball"
#: gap between balls, over the mean diameter, up to which they are listed as a pair that may meet
_SKIN = 0.2
#: iteration of an implicit step: relative change at which it is solved, relative change that counts
#: as rounding if it no longer falls, and most iterations
_CHANGE_OF_SOLUTION = 1e-14
_CHANGE_BY_ROUNDING = 1e-9
_MOST_ITERATIONS = 50
#: relative difference up to which the coefficients of contacts, over the roots of their radii, are
#: those of one material
_MATERIAL_SPREAD = 1e-2
#: share of a step to which the instant of a jump is found. Contacts that join or part within one
#: such share do so together, which loses no larger share of the energy of the jump
_SWITCH_SHARE = 1e-6
#: displacement of a ball since pairs were listed, over the margin of the list, above which they are
#: listed anew. At a half, two balls that are not listed may touch; the difference is for what balls
#: move until the next check
_LISTED_SHARE = 0.45
#: most times that a contact may join or part within one step
_MOST_SWITCHES = 20


@dataclass(frozen=True)
class Drive:
    """Balls or bodies that are displaced, or pushed by a force, along a direction. Give either the
    displacement or the force.

    Parameters
    ----------
    balls : index of a ball or body, or several indices, each once.
    direction : (1,) to (3,) vector, whose length does not matter.
    displacement : function of the time, s, that returns the displacement of the balls, m, zero at
        the time zero. The balls move so whatever acts on them; bodies that are held may be moved.
    force : function of the time, s, that returns the force on each of the balls, N.

    If one drive of a run is a displacement, the functions of all drives are also called for the
    time one step after the end, to find the last velocities. There they need not be finite.
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
    law : law of the normal forces; by default that of a crystal, and elsewhere
        :class:`~granphon.Hertz`. Of a :class:`~granphon.PowerLaw` only the exponent a is taken: the
        coefficient and the overlap of each contact follow from its force f and stiffness k, the
        overlap as a f/k. Another law is the same for all pairs. For the network of a
        :class:`~granphon.Crystal` that was repeated or cut, give the crystal as the law: its pairs
        then have their own laws.
    friction_coefficient : mu of Coulomb's limit of slip; by default contacts do not slide.
    damping, drag, dashpot, restitution : losses as in :meth:`Waves.response`, in which dashpots
        follow the present stiffness of contacts. Where numbers are given for each contact, (n_c,),
        contacts of balls that meet have their means. A collision of two balls has the
        ``restitution`` by Hertz's law alone; by other laws its restitution is another.
    viscous_pull : "whole": dashpots also pull while balls part. "limited": they pull by no more
        than the law pushes, so that both together never pull; a collision then loses less. Without
        dashpots, as with a restitution of 1, both are the same.
    coulomb : "elastic": the forces of springs obey Coulomb's limit, T <= mu f. "total": the forces
        of springs and dashpots together obey it, as in LAMMPS.
    geometry : "lattice": contacts are those of the network, in their directions at rest, and
        displacements are small against the balls. "exact": contacts have their true directions;
        balls may go anywhere, and meet others. Static tangential forces, and slip by the radii
        (``slip_levers`` of the network, as in LAMMPS), then act as they are, also their part
        without a potential: small motions are those of :meth:`Waves.whole_modes`, and the sum of
        energies is not kept exactly.
    gravity : (3,) or (d,) acceleration of the balls, m/s2, in addition to the load that holds a
        state at rest. A state that was found under gravity already has it in its load.

    Attributes
    ----------
    network : the balls at rest, and their contacts.
    geometry : "lattice" or "exact", as given.
    normal : the laws of the normal forces of all contacts, as functions of their elongation.
    punch : (n_c,) stiffnesses of flat punches as wide as the contacts at rest, N/m, to which
        stiffnesses against slip, twist and rolling are in proportion; normal stiffnesses if the
        law knows no radii of contacts.
    mu : the coefficient of friction; infinite if contacts do not slide.
    losses : the losses of the network.
    rules : how contacts follow motions: whether they turn, slide, and may be pulled by dashpots.
    gravity : (3,) acceleration, m/s2; zero if none is given.

    Raises
    ------
    InputError : if there is no network; for contacts that are not pressed, whose overlap does not
        follow by a power; for what is no contact law, a law that needs the balls of a crystal, a
        crystal that does not have the kinds of balls of the network, and any law beside a crystal;
        for another word than those of ``viscous_pull``, ``coulomb`` and ``geometry``; for a network
        with ``prestress`` and the geometry "lattice", in which its static forces act sideways; for
        one with ``prestress`` and the ``slip_levers`` "yade"; for numbers out of range; for gravity
        of another shape, or along an axis along which no ball moves; for a finite coefficient of
        friction above zero where no contact resists slip, and ``coulomb="total"`` without a finite
        coefficient.
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
        _require_geometry(network, self.geometry)
        crystal_state = state if isinstance(state, CrystalState) else None
        self._laws = self._find_laws(law, crystal_state, is_unloaded=isinstance(x, Crystal))
        self.normal = self._laws.normal
        self.punch = self._laws.punch
        mu = real_number(friction_coefficient)
        self.mu = (
            mu if mu == math.inf else not_negative("friction_coefficient", friction_coefficient)
        )
        given_losses = GivenLosses(damping, drag=drag, dashpot=dashpot, restitution=restitution)
        self.losses = Losses.of(network, given_losses)
        require_slip(self.mu, has_slip=resists_slip(network))
        if coulomb == "total" and self.mu == math.inf:
            why = "Without a friction_coefficient contacts do not slide"
            mend = "Give a friction_coefficient, or leave coulomb out"
            raise InputError('coulomb is "total", and there is no limit of slip', why, mend)
        self.rules = Rules(
            can_turn=geometry == "exact",
            mu=self.mu,
            can_pull=one_of("viscous_pull", viscous_pull, VISCOUS_PULLS) == "whole",
            is_total=one_of("coulomb", coulomb, COULOMB_LIMITS) == "total",
        )
        self.gravity: Array = _read_gravity(gravity, network)

    def __repr__(self) -> str:
        """Return the numbers of balls and contacts, and the exponent of the law if it is a
        power.
        """
        law = f", f ~ overlap^{self.normal.exponent:g}" if isinstance(self.normal, Powers) else ""
        balls = counted(self.network.n_balls, "ball")
        contacts = counted(self.network.n_contacts, "contact")
        return f"NonlinearWaves({balls}, {contacts}{law})"

    @property
    def overlap(self) -> Array:
        """(n_c,) overlaps at rest, m."""
        return self.normal.overlap

    def _find_laws(self, law: Any, state: CrystalState | None, is_unloaded: bool) -> _Laws:
        """Return the laws of the contacts of the network: those of the ``law``; or if it is None,
        those of the crystal of a ``state``, and without such a state Hertz's law.

        ``is_unloaded`` says that a crystal was given in place of a state, so that balls touch
        without force. Raises :class:`~granphon.base.errors.InputError` for any ``law`` beside such
        a crystal, for laws of balls that adhere, which only a crystal may have, for what is no law,
        and as :meth:`_make_crystal_laws` and :meth:`_make_power_laws` do.
        """
        if law is None and state is not None:
            return self._make_crystal_laws(state.crystal, is_unloaded)
        if isinstance(law, Crystal) and not is_unloaded:
            return self._make_crystal_laws(law, is_unloaded)
        if is_unloaded or isinstance(law, DMT | JKR):
            why = "The contacts of a crystal, and of balls that adhere, have the law of the crystal"
            raise InputError(
                f"law is {brief(law)}", why, "Give the law to the Crystal, and the Crystal here"
            )
        if isinstance(law, Hertz | PowerLaw | None):
            return self._make_power_laws(law)
        return self._make_single_law(law)

    def _make_crystal_laws(self, crystal: Crystal, is_unloaded: bool) -> _Laws:
        """Return the laws of contacts by the pairs of balls of a ``crystal``; contacts have no
        force at rest if ``is_unloaded``.

        Raises :class:`~granphon.base.errors.InputError` if the balls of the network are not of the
        kinds of the crystal.
        """
        network = self.network
        force = network.normal_force
        model = crystal.contact_model
        if network.contact_model is not None:  # it knows the walls of a network that was cut
            walls = dict.fromkeys([*model.walls, *network.contact_model.walls])
            model = replace(model, walls=tuple(walls))
        walls_and_kinds = (*crystal.names, RIGID_PLANE.name, *(wall.name for wall in model.walls))
        # the name in the crystal of each name of a kind in the network
        kinds = {name: name for name in walls_and_kinds}
        if not network.kinds and len(crystal.names) == 1:
            kinds[_BALL] = crystal.names[0]
        elif not network.kinds or not set(network.kinds) <= set(kinds):
            raise InputError(
                "the balls of the network are not of the kinds of the crystal", mend="Give a law"
            )

        def find_pair(name: str, other: str) -> tuple[Any, Any, Any]:
            """Return the law, kappa/(2 E* a) and E*, Pa, of balls of two kinds."""
            return model.law_of(kinds[name], kinds[other])

        groups = list[tuple[Any, Index]]()
        modulus = np.ones(force.size)
        for pair, contacts in self._group(network.i, network.j).items():
            law, _, modulus[contacts] = find_pair(*pair)
            groups.append((law, contacts))
        laws = ContactLaws(groups, force.size, modulus)
        overlap = laws.overlap(np.zeros_like(force) if is_unloaded else force)
        return _Laws(_simplify_laws(laws, overlap), laws, self._find_punch(laws), find_pair)

    def _make_single_law(self, law: Any) -> _Laws:
        """Return the laws of contacts that all have one ``law``, with overlaps from their forces at
        rest.

        kappa/(2 E* a) and E* of a pair that meets are the means over the contacts of such balls in
        the network, or over all contacts if there is none.
        """
        network = self.network
        force = network.normal_force
        pairs = self._group(network.i, network.j)
        pair_law = law_between(law, RIGID_PLANE, RIGID_PLANE)
        overlap = np.asarray(pair_law.overlap(force), float)
        # E* of the balls is not known: it is chosen so that 2 E* a, where a is the radius of the
        # contact, is the normal stiffness at rest; with E* = 1/2, 2 E* a is a itself
        radius = punch_stiffness(pair_law, overlap, 0.5)
        finite_radius = np.where(radius > 0.0, radius, np.inf)
        modulus = 0.5 * np.asarray(pair_law.stiffness(overlap)) / finite_radius
        laws = ContactLaws([(pair_law, np.arange(force.size))], force.size, modulus)
        punch = self._find_punch(laws)
        eta = network.shear_stiffness / punch

        def find_mean_law(*pair: str) -> tuple[Any, Any, Any]:
            """Return the law, and the means of kappa/(2 E* a) and E*, Pa, over the contacts of a
            ``pair`` of kinds.
            """
            contacts = pairs.get(pair, slice(None))
            return pair_law, np.mean(eta[contacts]), np.mean(modulus[contacts])

        return _Laws(_simplify_laws(laws, overlap), laws, punch, find_mean_law)

    def _make_power_laws(self, law: Any) -> _Laws:
        """Return laws that are powers of the overlap: their exponent is that of a ``law``, by
        default Hertz's, and their coefficients follow from forces and stiffnesses at rest.

        Raises :class:`~granphon.base.errors.InputError` for contacts that are not pressed.
        """
        network = self.network
        force = network.normal_force
        stiffness = network.normal_stiffness
        pairs = self._group(network.i, network.j)
        eta = network.shear_stiffness / stiffness
        if not np.all(force > 0.0):
            raise InputError(
                f"{np.count_nonzero(force <= 0.0)} of {force.size} contacts are not pressed",
                "Their overlap is not known",
                "Press the network, leave them out, or give a Crystal",
            )
        exponent = law.exponent if isinstance(law, PowerLaw) else hertz.EXPONENT
        overlap = exponent * force / stiffness
        powers = Powers(exponent, force / overlap**exponent, overlap)
        # a coefficient of Hertz's law grows with the root of the radius of the contact; that of
        # another power does not depend on radii, for which equal sizes stand
        sizes = np.ones_like(network.radii) if isinstance(law, PowerLaw) else network.radii
        coefficient_per_root = powers.coefficient / _root_radius(sizes, network.i, network.j)

        def find_mean_law(*pair: str) -> tuple[Any, Any, Any]:
            """Return the means of the coefficient over the root of the radius and of kappa/(2 E* a)
            over the contacts of a ``pair`` of kinds, and 1 in place of E*.

            Raises :class:`~granphon.base.errors.InputError` if the coefficients over the root
            differ by more than :data:`_MATERIAL_SPREAD` times their mean.
            """
            contacts = pairs.get(pair, slice(None))
            coefficients = coefficient_per_root[contacts]
            mean_coefficient = np.mean(coefficients)
            if np.ptp(coefficients) > _MATERIAL_SPREAD * mean_coefficient:
                kinds = " and ".join(pair)
                raise InputError(f"the contacts of {kinds} have no one law", mend="Give a Crystal")
            return mean_coefficient, np.mean(eta[contacts]), 1.0

        return _Laws(powers, powers, stiffness, find_mean_law, sizes)

    def _find_punch(self, laws: ContactLaws) -> Array:
        """Return the stiffnesses 2 E* a (n_c,), N/m, of the contacts under the forces of the
        network; if the ``laws`` know no radii a of contacts, their normal stiffnesses.
        """
        network = self.network
        if laws.has_radii:
            return laws.punch(laws.overlap(network.normal_force))
        return network.normal_stiffness

    def _join_laws(
        self, i: Index, j: Index
    ) -> tuple[Powers | PairLaws, Array, list[tuple[Index, str]]]:
        """Return the laws of the contacts of the network and, behind them, of the pairs ``i``,
        ``j`` (n_p,) of balls that may meet; kappa/(2 E* a) (n_p,) of these pairs; and the pairs
        without a law.

        The overlap of pairs is zero at the elongation zero, where they do not push. Pairs without a
        law never push. They are returned in groups: the indices of their contacts, behind those of
        the network, and the message of the error that is to end the run when they meet.
        """
        laws = self._laws.springs
        n = self.network.n_contacts
        groups = []
        unknown_groups = list[tuple[Index, str]]()
        overlap = np.append(self.overlap, np.zeros(len(i)))
        ratio = np.zeros(len(i))
        modulus = np.ones(len(i))
        for pair, members in self._group(i, j).items():
            try:
                law, ratio[members], modulus[members] = self._laws.find_pair_law(*pair)
                groups.append((law, n + members))
            except InputError as error:
                unknown_groups.append((n + members, str(error).rstrip(".")))
        if isinstance(laws, ContactLaws):
            joint_laws = ContactLaws(
                [*laws.groups, *groups], len(overlap), np.append(laws.modulus, modulus)
            )
            return _simplify_laws(joint_laws, overlap, len(i)), ratio, unknown_groups
        coefficient = np.append(laws.coefficient, np.zeros(len(i)))
        for coefficient_per_root, members in groups:
            pair_roots = _root_radius(self._laws.sizes, i[members - n], j[members - n])
            coefficient[members] = coefficient_per_root * pair_roots
        return Powers(laws.exponent, coefficient, overlap), ratio, unknown_groups

    def _group(self, i: Index, j: Index) -> dict[tuple[str, ...], Index]:
        """Return for each pair of kinds of balls, by their names in alphabetical order, the indices
        of those contacts between balls ``i`` and ``j`` (k,) that join these kinds.
        """
        is_plane = np.isinf(self.network.radii)
        kinds = self.network.kinds or np.where(is_plane, RIGID_PLANE.name, _BALL)
        names, code_of_ball = np.unique(kinds, return_inverse=True)
        lower_code, higher_code = np.sort(code_of_ball[[i, j]], axis=0)
        # one whole number for each pair of kinds: the codes are its digits
        keys = lower_code * len(names) + higher_code
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
        """Let the balls move for a ``duration``, s, and return their motion.

        Parameters
        ----------
        positions : positions of the balls at the start, (n, 3), m; by default those of the network.
            Or give ``displacements`` from there, m, which keep digits that positions lose. Where
            balls move along no axis beyond the d dimensions of the network, (n, d) serves too, and
            so for velocities.
        velocities, rotations, spins : those of the balls at the start, (n, 3), m/s, rad and rad/s;
            zero by default. (n, d) serves for rotations and spins where balls turn about no axis
            beyond the first d: balls in a plane turn about z, and need (n, 3). Contacts come from
            rest to the start in one step, in which they slide only as far as Coulomb's limit makes
            them.
        drive : a :class:`Drive`, or several.
        frames : number of times at which the motion is kept; the first is the start, the last the
            end.
        step : time step, s; it is shortened so that a frame has a whole number of steps. The
            default is a sixtieth of the shortest period that the stiffest contact and its dashpots
            allow at the start. If this period later comes to have fewer than 30 steps, as when a
            drive presses balls that only touch, the default is halved and the run begins anew. A
            step is cut where a contact whose force jumps closes or opens.
        scheme : "verlet" is explicit and symplectic; its sum of energies differs from a constant by
            the square of the step, and wanders where contacts open. "midpoint" is implicit: it
            finds the forces some five times in a step, and takes seven to fourteen times as long.
            Its sum of energies is constant to rounding, with losses.
        file : path to which frames are written as they come, for :meth:`Motion.read`; the file of
            an earlier motion is replaced. The file can be read at any time, also after the program
            was killed.
        progress : is told how many frames are done.

        A run ends early in these cases, with a
        :class:`~granphon.base.errors.StoppedEarlyWarning`, and returns the motion so far:

        - Ctrl-C stops it after the first frame; before, KeyboardInterrupt is raised.
        - In a frame, a ball has left its place along x, y or z by half of the mean diameter, with
          geometry "lattice".
        - Balls without a known law meet, with geometry "exact".
        - A drive is not a finite number at a time after the start.
        - The ``step``, as given or after ten halvings, is too long: contacts have become too stiff,
          an implicit step has no solution, or a contact whose force jumps opens and closes many
          times in a step.

        A :class:`~granphon.base.errors.LimitWarning` says that contacts became wider than the law
        allows (:func:`~granphon.validity`), or that contacts are more viscous than stiff at all
        frequencies of the run, of which the inverse of the duration is the lowest. Another warning
        says that loops are not compiled, and why.

        Raises
        ------
        InputError : for numbers, shapes and words that are not allowed; for positions and
            displacements together; for more frames than memory holds; for a start that moves a body
            that is held or that a drive displaces, or moves balls along an axis along which they do
            not move; for what is no :class:`Drive`, or one of no ball, of a ball that is not there
            or is named twice, along which balls do not move, or whose function is not finite at the
            time zero; for a displacement that does not begin at zero, a force on a body that is
            held, two drives of a ball of which one is a displacement, and drives that displace all
            balls; if no contact resists a motion of the balls and no step is given; for a
            ``step`` too long for the stiffest contact, more than ten million steps, and steps too
            short, balls too fast or contacts too stiff for double precision; and for a ``file``
            that is no path.
        OutputError : if the ``file`` is no motion, another run is writing it, or it cannot be
            written.
        """
        duration = positive("duration", duration, "s")
        n_frames = whole_number("frames", frames, 2, _MOST_STEPS)
        one_of("scheme", scheme, SCHEMES)
        self._require_frames_memory(n_frames, to_file=file is not None)
        why_uncompiled = find_why_uncompiled()
        if why_uncompiled:
            warnings.warn(why_uncompiled, stacklevel=2)
        if positions is not None:
            if displacements is not None:
                raise InputError("positions and displacements are given", mend="Give one of both")
            displacements = self._find_displacements(positions)
        system = _System(self, _list_drives(drive))
        x = system.read("displacements", displacements) + system.read("rotations", rotations)
        v = system.read("velocities", velocities) + system.read("spins", spins)
        first_step, top = self._choose_step(system, x, v, step)
        require_steps(duration / first_step)  # also if the quotient is infinite
        # no motion of the run is slower than the run is long, or faster than contacts are
        for sentence in self.losses.find_warnings(min(1.0 / duration, top / (2.0 * math.pi))):
            warnings.warn(f"in the motion {sentence.rstrip('.')}", LimitWarning, stacklevel=2)
        request = _Request(
            duration, n_frames, scheme, file, progress, is_step_given=step is not None
        )
        recorder, stop_reason = _run_to_end(system, x, v, first_step, request)
        _warn_of_width(system.widest)
        if stop_reason:
            _warn_of_early_end(stop_reason, recorder.last_time, duration)
        return recorder.join()

    def _choose_step(
        self, system: _System, x: Array, v: Array, step: float | None
    ) -> tuple[float, float]:
        """Return the time step, s, of a run that starts at mass-weighted motions x (size,) with
        velocities v (size,), and a bound of the frequencies of contacts, rad/s.

        The step is the ``step`` of the user, s, or the default. Raises
        :class:`~granphon.base.errors.InputError` if the user's step is no time, or too long, and
        what :meth:`_System.find_pressed_stiffness`, :meth:`_System.choose_step` and
        :meth:`_System.find_rate` raise.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(system.operator.values(v) ** 2, axis=1)
            largest_energy = 0.5 * float(np.max(squares))  # of a ball, J
            stiffness = system.find_pressed_stiffness(x, largest_energy)
            top = system.bound.find(stiffness)
            if step is None:
                return system.choose_step(stiffness), top
            rate = system.find_rate(stiffness)
        given_step = positive("step", step, "s")
        if given_step * rate * _LEAST_STABLE_STEPS > 2.0 * math.pi:
            raise InputError(
                f"the step of {given_step:.3g} s is too long for the stiffest contact, or its"
                f" damping",
                "It would not be stable",
                "Leave step out",
            )
        return given_step, top

    def find_step(self, speed: float = 0.0, force: float = 0.0, displacement: float = 0.0) -> float:
        """Return an estimate of the time step, s, of a :meth:`run` that is given none.

        Parameters
        ----------
        speed : greatest speed of a ball at the start, m/s; the heaviest ball is taken to have it.
        force, displacement : greatest force, N, and displacement, m, of drives.

        With the speed alone this is the step with which :meth:`run` begins, before the step is
        shortened so that a frame has a whole number of steps. A run does not know beforehand which
        force or displacement its drives reach: it halves its step later, where contacts become much
        stiffer.

        Raises :class:`~granphon.base.errors.InputError` for what is no finite number, zero or
        above; if no contact resists a motion of the balls; and for balls too fast, or contacts too
        stiff, for double precision.
        """
        speed = not_negative("speed", speed, "m/s")
        force = not_negative("force", force, "N")
        displacement = not_negative("displacement", displacement, "m")
        system = _System(self, [])
        masses = self.network.masses[self.network.moving]
        energy = 0.5 * float(np.max(masses)) * speed * speed
        rest_motions = np.zeros(system.operator.size)
        with np.errstate(over="ignore", invalid="ignore"):
            return system.choose_step(
                system.find_pressed_stiffness(rest_motions, energy, force, displacement)
            )

    def _require_frames_memory(self, n_frames: int, *, to_file: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``n_frames`` frames of a motion take
        more memory than there is; of frames that go ``to_file``, only two are held in memory.
        """
        n_held = 2 if to_file else n_frames
        memory = motion_memory(self.network.n_balls, self.network.n_contacts, n_held)
        frames = f"{n_frames:,} frames of a motion of {self.network.n_balls:,} balls"
        require_memory(frames, memory, "Give fewer frames")

    def _find_displacements(self, positions: ArrayLike) -> Array:
        """Return the displacements of balls at ``positions``, m, both (n, 3) or (n, d).

        Raises what :meth:`_require_shape` raises.
        """
        places = real_array("positions", positions)
        self._require_shape("positions", places)
        return np.asarray(places - self.network.positions[:, : places.shape[1]])

    def _require_shape(self, name: str, values: Array) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless ``values``, of the argument
        ``name``, have the shape (n, 3) or (n, d) and are finite.
        """
        n = self.network.n_balls
        d = self.network.dimension
        mend = f"Give ({n}, 3) finite numbers, one row for each ball"
        if values.shape not in ((n, 3), (n, d)):
            raise InputError(f"{name} has the shape {values.shape}", mend=mend)
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} has a number that is not finite", mend=mend)


def require_steps(count: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if a run of ``count`` steps would have more
    than :data:`_MOST_STEPS`.
    """
    if count > _MOST_STEPS:
        mend = "Give a shorter duration, fewer frames, a longer step, or less damping"
        raise InputError(
            f"the run takes {count:.3g} steps", f"More than {_MOST_STEPS:.0e} are not made", mend
        )


def _require_geometry(network: ContactNetwork, geometry: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if motions with a ``geometry`` cannot follow
    the static forces of a ``network`` with prestress, or its ``slip_levers``.
    """
    if not network.prestress:
        return
    if geometry == "lattice":
        raise InputError(
            "static forces act sideways in this network",
            "Contacts keep their directions in this motion, and static forces would turn them",
            'Give geometry="exact"',
        )
    if network.slip_levers == "yade":
        raise InputError(
            'the network has slip_levers="yade"',
            "YADE counts slip (R_i + R_j)/r times, by the present distance r of the centres;"
            " motions of any amplitude have slip by levers alone, arms or radii",
            'Read it with slip_levers="radii", whose small motions differ by parts of the order'
            " of overlap/diameter, or take the small motions of gp.Waves",
        )


def resists_slip(network: ContactNetwork) -> bool:
    """Whether a contact of the ``network`` resists slip; none does where balls have no friction, or
    move along a line, so that contacts do not slip.
    """
    return network.ball_motions.count > 1 and bool(np.any(network.shear_stiffness))


def require_slip(mu: float, *, has_slip: bool) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a coefficient of friction ``mu`` above
    zero and not infinite, unless a contact resists slip, ``has_slip``.
    """
    if has_slip or mu == 0.0 or mu == math.inf:
        return
    raise InputError(
        f"friction_coefficient is {mu:g}, and no contact resists slip",
        "The balls have no friction, or move along a line",
        "Leave friction_coefficient out, or give balls with friction that move in a plane or in"
        " space",
    )


def _read_gravity(gravity: Any, network: ContactNetwork) -> Array:
    """Return the acceleration (3,) of the balls, m/s2, from ``gravity``, (3,) or (d,), or zero for
    None.

    Raises :class:`~granphon.base.errors.InputError` for another shape, numbers that are not finite,
    and a direction along which balls do not move.
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


def _count_steps(duration: float, step: float, n_frames: int) -> int:
    """Return the number of steps from frame to frame, each of at most ``step``, s, but for
    rounding, in a run of a ``duration``, s, with ``n_frames`` frames.

    Raises :class:`~granphon.base.errors.InputError` for too many steps, and for steps so short that
    they leave the range of double precision.
    """
    interval = duration / (n_frames - 1)
    steps_per_frame = 1
    if interval >= hertz.LEAST_NORMAL:
        require_steps(duration / step)  # first, as an infinite quotient cannot be rounded up
        steps_per_frame = max(1, math.ceil(interval / step * (1.0 - _ROUNDING)))
        require_steps(steps_per_frame * (n_frames - 1))
    if not interval / steps_per_frame >= hertz.LEAST_NORMAL:
        raise InputError(
            f"the steps of a run of {duration:.3g} s with {n_frames} frames are too short",
            "They are below the range of double precision",
            "Give a longer duration",
        )
    return steps_per_frame


class _Request(NamedTuple):
    """What :meth:`NonlinearWaves.run` is asked for, beside the start and the drives.

    Attributes
    ----------
    duration : length of the run, s.
    n_frames : number of frames, the start among them.
    scheme : "verlet" or "midpoint".
    file : path of the file of the frames; None to keep them in memory.
    progress : is told how many frames are done.
    is_step_given : whether the user gave the time step, which is then not halved.
    """

    duration: float
    n_frames: int
    scheme: str
    file: Any
    progress: Progress
    is_step_given: bool


class _Schedule(NamedTuple):
    """The steps and frames of a run with one time step.

    Attributes
    ----------
    steps_per_frame : number of steps from frame to frame.
    n_frames : number of frames, the start among them.
    least_per_period : least number of steps in the shortest period of contacts; with fewer the run
        stops.
    """

    steps_per_frame: int
    n_frames: int
    least_per_period: float


def _run_to_end(
    system: _System, x: Array, v: Array, first_step: float, request: _Request
) -> tuple[Frames, str]:
    """Run the ``system`` from mass-weighted motions x with velocities v (size,), and return its
    frames and the reason why the run ended early; an empty text if it did not.

    A step is at most ``first_step``, s. If steps turn out to be too long, and the user gave none,
    the step is halved and the run begins anew, up to :data:`_MOST_HALVINGS` times. Raises
    :class:`~granphon.base.errors.InputError` for too many steps, and what :func:`_record` raises.
    """
    interval = request.duration / (request.n_frames - 1)
    step = min(first_step, interval)
    n_halvings = 0 if request.is_step_given else _MOST_HALVINGS
    least_per_period = _LEAST_STABLE_STEPS if request.is_step_given else _LEAST_CHOSEN_STEPS
    while True:
        steps_per_frame = _count_steps(request.duration, step, request.n_frames)
        schedule = _Schedule(steps_per_frame, request.n_frames, least_per_period)
        recorder = Frames(system.waves.network, interval / steps_per_frame, request.file)
        stop_reason = _record(system, x, v, schedule, request, recorder)
        if n_halvings == 0 or stop_reason not in (_LONG_STEP, _NO_SOLUTION, _RATTLE):
            return recorder, stop_reason
        step *= 0.5
        n_halvings -= 1


def _warn_of_width(widest: float) -> None:
    """Issue a :class:`~granphon.base.errors.LimitWarning` if contacts became wider than the law
    allows: ``widest`` is the greatest radius of a contact over that of its smaller ball.
    """
    warning = check_limit("contact_radius", widest).warning
    if warning is not None:
        sentence = f"in the motion {warning[0].lower()}{warning[1:].rstrip('.')}"
        warnings.warn(sentence, LimitWarning, stacklevel=3)  # at the call of NonlinearWaves.run


def _warn_of_early_end(reason: str, end: float, duration: float) -> None:
    """Issue the :class:`~granphon.base.errors.StoppedEarlyWarning` of a run of a ``duration``, s,
    that ended after the time ``end``, s, for a ``reason``; it says whether Ctrl-C was the reason.
    """
    warning = StoppedEarlyWarning(
        f"the motion ends after {end:.4g} s of {duration:.4g} s: {reason}"
    )
    warning.interrupted = reason == _CTRL_C
    warnings.warn(warning, stacklevel=3)  # at the call of NonlinearWaves.run


def _record(
    system: _System, x: Array, v: Array, schedule: _Schedule, request: _Request, recorder: Frames
) -> str:
    """Run the ``system`` from mass-weighted motions x with velocities v (size,), let the
    ``recorder`` take its frames, and return the reason why the run ended early; an empty text if it
    did not. The recorder is closed.

    The progress of the ``request`` is told of each frame after the start. A KeyboardInterrupt
    before the first frame is raised, and what :meth:`_System.integrate` raises but :class:`_Stop`.
    """
    # numbers that leave the floating range end the run later, by _require_short
    floating_errors = np.errstate(over="ignore", invalid="ignore")
    motion_progress = request.progress.step("motion", schedule.n_frames - 1)
    with recorder, single_products(), floating_errors, motion_progress as frame_progress:
        try:
            for is_after_start in system.integrate(x, v, schedule, request.scheme, recorder):
                if is_after_start:
                    frame_progress.advance()
        except KeyboardInterrupt:
            if not len(recorder):  # Ctrl-C came while loops were compiled, or a file was begun
                raise
            return _CTRL_C
        except _Stop as stop:
            return str(stop)
    return ""


class _Stop(Exception):
    """A run cannot go on; its text is the reason."""


#: displacements or forces of no drives
_NO_NUMBERS = np.zeros(0)
#: reasons why a run ends early
_CTRL_C = "Ctrl-C"
_LONG_STEP = "the step is too long for contacts that have become stiffer"
_NO_SOLUTION = "an implicit step has no solution: scheme: verlet makes it"
_RATTLE = "a contact whose force jumps opens and closes many times in a step"


class _Laws(NamedTuple):
    """Normal laws of the contacts of a network, and of balls that meet.

    Attributes
    ----------
    normal : laws of the contacts, as functions of their elongation since rest.
    springs : the same laws, as groups of contacts with one law; :class:`Powers` if one exponent is
        given for all contacts.
    punch : (n_c,) stiffnesses 2 E* a, N/m, of the contacts under the forces of the network; normal
        stiffnesses if laws know no radii a of contacts. Balls that touch without load have the
        small forces of :meth:`Crystal.touch` here.
    find_pair_law : function of the names of two kinds of balls. It returns the law of such balls
        that meet, kappa/(2 E* a) and E*, Pa, or raises InputError if the law is not known. If one
        exponent is given for all contacts, it returns the coefficient over the root of the radius
        in place of the law, and 1 in place of E*.
    sizes : (n,) numbers that stand for the radii of balls in coefficients, if one exponent is given
        for all contacts: the radii, or ones if the coefficient does not depend on them; else empty.
    """

    normal: Powers | PairLaws
    springs: Powers | ContactLaws
    punch: Array
    find_pair_law: Callable[..., tuple[Any, Any, Any]]
    sizes: Array = _NO_NUMBERS


def _simplify_laws(springs: ContactLaws, overlap: Array, n_apart: int = 0) -> Powers | PairLaws:
    """Return the laws ``springs`` of contacts with the ``overlap`` (n_c,), m, at rest as functions
    of elongations: as :class:`Powers`, which are faster, if all are powers with one exponent, else
    as :class:`PairLaws`.

    The last ``n_apart`` contacts are pairs of balls that may meet.
    """
    exponents = {getattr(law, "exponent", hertz.EXPONENT) for law, _ in springs.groups}
    are_powers = all(isinstance(law, HertzLaw | PowerLaw) for law, _ in springs.groups)
    if len(exponents) > 1 or not are_powers:
        return PairLaws(springs, overlap, n_apart)
    coefficient = np.zeros(len(overlap))
    for law, contacts in springs.groups:
        coefficient[contacts] = law.coefficient  # type: ignore[attr-defined]  # a power
    return Powers(exponents.pop() if exponents else hertz.EXPONENT, coefficient, overlap)


def _root_radius(radii: Array, i: Index, j: Index) -> Array:
    """Return the root (k,) of the radius R of contacts of balls ``i`` and ``j`` (k,), where
    1/R = 1/R_i + 1/R_j with the ``radii`` (n,) of all balls.
    """
    return np.asarray(1.0 / np.sqrt(1.0 / radii[i] + 1.0 / radii[j]))


class _Trial(NamedTuple):
    """A step that was computed, and may be made.

    Its arrays are the spare ones of the system: the next trial writes over them.

    Attributes
    ----------
    step : length of the step, s.
    strokes, drive_forces : displacements, m, and forces, N, of drives at the end of the step.
    x : (size,) mass-weighted motions at the end of the step.
    drift : (size,) mean velocity of these motions in the step.
    end_moment : the contacts at the end of the step.
    acceleration : (size,) mean acceleration of an implicit step.
    friction : energy that slip, twist and rolling take up in an implicit step, J.
    damping : energy that dashpots and drag take up in an implicit step, J.
    resistances : forces, N, that resist each displacement of a drive in an implicit step.
    """

    step: float
    strokes: Array
    drive_forces: Array
    x: Array
    drift: Array
    end_moment: Moment
    acceleration: Any = None
    friction: float = 0.0
    damping: float = 0.0
    resistances: Any = None


@dataclass
class _Energies:
    """Energies of a motion since its start, J.

    Attributes
    ----------
    friction : energy that slip, twist and rolling have taken up; a part of it is still stored.
    damping : energy that dashpots and drag have taken up.
    work : work of drives.
    jumps : energy that was lost where contacts joined and parted.
    """

    friction: float = 0.0
    damping: float = 0.0
    work: float = 0.0
    jumps: float = 0.0


def _find_stiffest(normal: Powers | PairLaws, e: Array) -> Array:
    """Return the largest stiffness (n_c,), N/m, of each contact on the way to its elongation ``e``
    (n_c,), m, at which it is pressed. It is taken to be that at the end, as stiffnesses grow with
    the overlap: the normal one, or that of a flat punch as wide as the contact if it is larger. By
    a tabulated law, whose stiffness may fall, it is the largest normal one.
    """
    _, stiffness = normal.press(e)
    if isinstance(normal, PairLaws):
        if normal.has_radii:
            stiffness = np.maximum(stiffness, normal.punch(e, np.empty_like(stiffness)))
        for law, contacts in normal.springs.groups:
            if isinstance(law, TabulatedLaw):
                stiffness[contacts] = law.find_stiffest((normal.overlap - e)[contacts])
    return stiffness


def _list_drives(drive: Any) -> list[Any]:
    """Return the drives of the argument ``drive`` of a run: several in a list or tuple, a single
    one, or None for no drive.
    """
    if drive is None:
        return []
    return list(drive) if isinstance(drive, list | tuple) else [drive]


def _read_drives(
    drives: Sequence[Any], network: ContactNetwork
) -> tuple[list[tuple[Index, Array]], list[tuple[Index, Array]]]:
    """Return the bodies (k,) and the direction (3,), of length one, of each of the ``drives`` that
    is a displacement, and in a second list those of each drive that is a force.

    Raises :class:`~granphon.base.errors.InputError` for drives that :meth:`NonlinearWaves.run`
    refuses in this ``network``.
    """
    moved_bodies = []
    pushed_balls = []
    for drive in drives:
        balls, direction = _read_drive(drive, network)
        if drive.force is None:
            moved_bodies.append((balls, direction))
            continue
        if not np.all(network.moving[balls]):
            raise InputError("a force acts on a body that is held", mend="Give its displacement")
        pushed_balls.append((balls, direction))
    all_moved_bodies = np.concatenate(
        [balls for balls, _ in moved_bodies] or [np.zeros(0, np.intp)]
    )
    is_moved_twice = len(np.unique(all_moved_bodies)) < len(all_moved_bodies)
    if is_moved_twice or any(np.any(np.isin(balls, all_moved_bodies)) for balls, _ in pushed_balls):
        raise InputError(
            "a ball has two drives, of which one is a displacement",
            "It moves as the displacement says, whatever acts on it",
            "Give it one drive",
        )
    return moved_bodies, pushed_balls


def require_drives(waves: NonlinearWaves, drives: Sequence[Drive]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for drives that :meth:`NonlinearWaves.run` of
    these ``waves`` refuses. The functions of the drives are called for the time zero.
    """
    _System(waves, drives).evaluate_start()


def _read_drive(drive: Any, network: ContactNetwork) -> tuple[Index, Array]:
    """Return the bodies (k,) and the direction (3,), of length one, of a ``drive``.

    Raises :class:`~granphon.base.errors.InputError` for what is no :class:`Drive` with one
    function, and for bodies and a direction that are not those of the ``network``, or along which
    its balls do not move.
    """
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
    direction = read_vector("direction", drive.direction, network.dimension)
    require_moves("drive", direction, network)
    return balls, direction


class _RateBound:
    """Bounds of the rates of a network whose contacts have any normal stiffness: the largest sum of
    the sizes of the numbers in a row of its matrix.

    The stiffnesses against slip, twist and rolling are in proportion to those of flat punches as
    wide as the contacts, which are ``punch`` (n_c,), N/m, at rest.
    """

    def __init__(self, operator: WaveOperator, punch: Array) -> None:
        rows = operator.law_rows
        self._ratios = [row.stiffness / punch for row in rows[1:]]
        # weights of slip are multiplied by this ratio; the viscosity of a dashpot against slip does
        # not go with the stiffness, and is first divided by the ratio
        slip_ratio = operator.network.shear_stiffness / punch
        self._per_slip = np.divide(
            1.0, slip_ratio, out=np.zeros_like(slip_ratio), where=slip_ratio > 0.0
        )
        self._n_contacts = operator.network.n_contacts
        deform = abs(operator.compose(rows))
        self._pull = deform.T.tocsr()
        self._row_sums = deform @ np.ones(operator.size)
        self._anchors = operator.anchors

    def find(self, stiffness: Array) -> float:
        """Return a bound of the angular frequencies, rad/s, of contacts with the normal
        ``stiffness`` (n_c or more,), N/m, those of the network first.

        Further contacts are of balls that have met. These contacts may be at any ball, so that each
        contact of the network counts as at least as stiff as the stiffest of them.
        """
        stiffness = self._raise_stiffness(stiffness)
        return math.sqrt(np.max(self._bound(stiffness, stiffness) + self._anchors))

    def find_viscous(self, stiffness: Array, losses: Losses) -> float:
        """Return a bound of the rates, 1/s, at which all ``losses`` slow motions down, for contacts
        with the normal ``stiffness`` (n_c or more,), N/m, as for :meth:`find`.
        """
        stiffness = self._raise_stiffness(stiffness)
        *_, normal, side, root = losses.dashpots
        rate = np.max(losses.drag)
        # most often there are no dashpots
        longest_time = np.max(losses.damping)
        if longest_time > 0.0:
            rate = rate + longest_time * np.max(self._bound(stiffness, stiffness))
        if np.any(normal) or np.any(side) or np.any(root):
            root_dashpots = root * np.sqrt(stiffness)
            viscous = self._bound(normal + root_dashpots, (side + root_dashpots) * self._per_slip)
            rate = rate + np.max(viscous)
        return float(rate)

    def find_allowed(self, frequency: float, viscous: float, losses: Losses) -> float:
        """Return the greatest normal stiffness, N/m, with which, if all contacts have it, the bound
        of :meth:`find` is at most the ``frequency``, rad/s, and that of :meth:`find_viscous` at
        most the rate ``viscous``, 1/s; zero if no stiffness is allowed, and infinite if each is.

        The square of the first bound is linear in the stiffness, and the second bound in the
        stiffness and its root. So the stiffness that each motion allows follows from the bounds of
        contacts of stiffness one.
        """
        ones = np.ones(self._n_contacts)
        bound = self._bound(ones, ones)
        *_, normal, side, root = losses.dashpots
        constant = self._bound(normal, side * self._per_slip) + np.max(losses.drag)
        square_room = frequency**2 - self._anchors
        rate_room = viscous - constant
        if np.min(square_room) < 0.0 or np.min(rate_room) < 0.0:
            return 0.0
        # the root x of the stiffness solves a x^2 + b x = rate_room; so written no digits are lost
        a = np.max(losses.damping) * np.max(bound)
        b = self._bound(root, root * self._per_slip)
        denominator = b + np.sqrt(b**2 + 4.0 * a * rate_room)
        root_without_loss = 0.0 if a else math.inf  # of a motion with b and rate_room zero
        with np.errstate(divide="ignore", invalid="ignore"):
            largest_root = np.where(
                denominator > 0.0, 2.0 * rate_room / denominator, root_without_loss
            )
            largest_stiffness = np.where(bound > 0.0, square_room / bound, math.inf)
        return float(min(np.min(largest_stiffness), np.min(largest_root) ** 2))

    def _raise_stiffness(self, stiffness: Array) -> Array:
        """Return the stiffness (n_c,), N/m, of the contacts of the network, where each counts as at
        least as stiff as any contact of balls that have met; ``stiffness`` (n_c or more,) has the
        contacts of such balls last.
        """
        count = self._n_contacts
        if len(stiffness) > count:  # balls have met
            return np.asarray(np.maximum(stiffness[:count], stiffness[count:].max()))
        return stiffness

    def _bound(self, normal: Array, side: Array) -> Array:
        """Return for each row of A^T W A a bound (size,) of the sum of the sizes of its numbers;
        the largest of these sums bounds the eigenvalues.

        The diagonal W has the weights ``normal`` (n_c,) for elongations, and for each other kind of
        deformation the weights ``side`` (n_c,) times the stiffness of this kind over that of a
        punch.
        """
        weights = np.concatenate([normal, *(ratio * side for ratio in self._ratios)])
        return np.asarray(self._pull @ (weights * self._row_sums))


class _System:
    """The equations of motion of a network with drives, and its state at the present time of a run.

    The constructor sets the first six of the attributes below. :meth:`_begin` sets the others for a
    run, and steps change all of them but ``step``. The constructor raises what :func:`_read_drives`
    and :class:`WaveOperator` raise.

    Attributes
    ----------
    waves : the waves, with the network at rest, the laws and the losses.
    drives : the drives, displacements and forces.
    moved_bodies : for each drive that is a displacement its bodies (k,) and its direction (3,), of
        length one.
    network : the network of the waves, in which bodies that drives displace have infinite masses.
    operator : the dynamical matrix of this network, by whose vectors (size,) motions are numbered.
    bound : the bounds of the rates of motions, from which the time step follows.
    step : time step, s; contacts whose force jumps cut a step into parts.
    x, v : (size,) mass-weighted motions and velocities now.
    acceleration, last_acceleration : (size,) mass-weighted accelerations with which the next step
        begins, and those of the step before, of which an implicit step makes its first guess.
    contacts : the contacts of the network and of pairs of balls that may meet.
    current : the contacts now.
    joined : (n_c,) whether each contact is joined, for laws whose force jumps; None for others.
    strokes, drive_forces : displacements, m, and forces, N, of the drives now.
    resistances : forces, N, with which contacts and the load now resist each displacement of a
        drive.
    energies : energies since the start.
    widest : greatest radius of a contact over that of its smaller ball, in all frames so far.
    """

    current: Moment
    joined: Any
    strokes: Array
    drive_forces: Array
    energies: _Energies
    #: positions (n, 3), m, of balls when pairs that may meet were listed last
    _listed_positions: Array
    #: bound of the distance, m, that a ball has gone since
    _travelled: float

    def __init__(self, waves: NonlinearWaves, drives: Sequence[Any]) -> None:
        network = waves.network
        self.waves = waves
        self.drives = drives
        self.moved_bodies, pushed_balls = _read_drives(drives, network)
        masses = network.masses.copy()
        for balls, _ in self.moved_bodies:
            masses[balls] = np.inf  # a drive moves them, and no force does
        self.network = replace(network, masses=masses) if self.moved_bodies else network
        operator = WaveOperator(self.network)
        self.operator = operator
        axes = list(operator.motions.translations)
        # bodies that drives displace, and their directions by the displacements that balls have
        self._along = [(balls, direction[axes]) for balls, direction in self.moved_bodies]
        self.bound = _RateBound(operator, waves.punch)
        # index (size,) of each number of a vector in the flattened motions (n, m) of all balls
        indices = operator.indices
        self._places = np.flatnonzero(indices.ravel() >= 0)
        # factor (size,) by which a mass-weighted motion becomes a displacement, kg^-1/2, or a
        # rotation, kg^-1/2/m
        _, self._scale = operator.flat_indices_and_scale
        self._stroke_functions = [
            drive.displacement for drive in drives if drive.displacement is not None
        ]
        self._force_functions = [drive.force for drive in drives if drive.force is not None]
        # mass-weighted accelerations by 1 N of each force, and by gravity
        pushes = [
            operator.push(balls, direction, 1.0 / np.sqrt(masses[balls]))
            for balls, direction in pushed_balls
        ]
        self._push = np.reshape(pushes, (-1, operator.size))
        self._weight = operator.push(operator.balls, waves.gravity, np.sqrt(masses[operator.balls]))
        self._drag = operator.drag(waves.losses)
        self._has_drag = bool(np.any(self._drag))
        is_moving = self.network.moving
        self._least_root_mass = math.sqrt(float(np.min(masses[is_moving])))
        self._mean_radius = float(np.mean(self.network.radii[is_moving]))
        # margin of the list of pairs that may meet, m
        self._skin = _SKIN * 2.0 * self._mean_radius

    def _set_contacts(self, i: Index, j: Index, shift: Index) -> None:
        """Make ``contacts`` anew: those of the network and, behind them, those of the pairs of
        balls ``i`` and ``j`` (n_p,) that may meet, ``shift`` (n_p, 3) periods apart.

        The scheme must have been set before. The method also sets the forces at rest, the laws, and
        the pairs without a law, at whose contact the run ends. The caller sets the state of the
        contacts: :meth:`_begin` that of the start, :meth:`_carry_over` the present one.
        """
        waves = self.waves
        law = waves.normal
        ratio = np.zeros(0)
        self._unknown_groups: list[tuple[Index, str]] = []
        radii = self.network.radii
        ends = np.append(self.network.i, i), np.append(self.network.j, j)
        # radius of a contact by Hertz, over the radius of the smaller ball, for the overlap 1 m: it
        # grows with the root of the overlap
        self._width_ratio = _root_radius(radii, *ends) / np.minimum(*(radii[end] for end in ends))
        if len(i):
            law, ratio, self._unknown_groups = waves._join_laws(i, j)
        pairs = MetPairs(i, j, shift, ratio, self._extra_overlap if waves.rules.can_turn else 0.0)
        self.contacts = MovingContacts(
            self.network, pairs, law, waves.punch, waves.losses, waves.rules
        )
        load = -self._accelerate(self.contacts.still, np.zeros(self.operator.size))
        self._steady: Array = load + self._weight
        self._knows_law = self.contacts.is_hertz and self._is_explicit and not self._unknown_groups

    def _accelerate(self, forces: Array, steady: Array) -> Array:
        """Return the mass-weighted accelerations (size,) by ``forces`` (n, m), N, on balls, plus
        the ``steady`` accelerations (size,).
        """
        acceleration = np.empty(self.operator.size)
        gather(forces, self._places, self._scale, steady, acceleration)
        return acceleration

    def _spread(self, x: Array, strokes: Array, motions: Array) -> None:
        """Write into ``motions`` (n, m) the motions of all balls: those of the vector ``x``
        (size,), and those of driven bodies with their ``strokes``, m. For velocities, strokes are
        speeds.
        """
        spread(x, self._places, self._scale, motions)
        for (balls, along), stroke in zip(self._along, strokes, strict=True):
            motions[balls, : len(along)] = stroke * along

    @property
    def _extra_overlap(self) -> float:
        """Mean over the contacts without a flat wall, m, of the overlap that a contact has at rest
        by its force and law, less the overlap of its balls by radii and positions; zero if there
        are no such contacts.
        """
        network = self.network
        # the distance of a ball from a flat wall is infinite
        contacts = np.flatnonzero(np.isfinite(network.distance))
        i = network.i[contacts]
        j = network.j[contacts]
        gaps = network.distance[contacts] - network.radii[i] - network.radii[j]
        return float(np.mean(self.waves.overlap[contacts] + gaps)) if len(i) else 0.0

    def read(self, name: str, value: ArrayLike | None) -> Array:
        """Return the ``value`` of an argument, vectors (n, 3) of all balls, as mass-weighted
        motions (size,); zeros for None. Vectors (n, d) serve if balls do not move along, or turn
        about, an axis beyond the first d.

        ``name`` is that of the argument of :meth:`NonlinearWaves.run`, which says whether vectors
        are of translations or of rotations. Raises :class:`~granphon.base.errors.InputError` for
        another shape, and for vectors that are not finite, along which balls do not move or turn,
        or of a ball that is held or that a drive displaces.
        """
        operator = self.operator
        network = self.network
        if value is None:
            return np.zeros(operator.size)
        values = real_array(name, value)
        self.waves._require_shape(name, values)
        is_rotation = name in ("rotations", "spins")
        axes = operator.motions.rotations if is_rotation else operator.motions.translations
        if values.shape[1] <= max(axes, default=0):
            raise InputError(
                f"{name} has the shape {values.shape}", mend=f"Give ({network.n_balls}, 3)"
            )
        values = np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
        require_moves(name, values, network, is_rotation)
        is_wrong = np.any(values, axis=1) & ~network.moving
        if np.any(is_wrong):
            raise InputError(
                f"{name} of ball {np.flatnonzero(is_wrong)[0]} are not zero",
                "It is held, or is displaced by a drive, whatever acts on it",
                "Let them be zero",
            )
        motions = np.zeros((network.n_balls, 6))  # displacements and rotations
        columns = slice(3, 6) if is_rotation else slice(0, 3)
        motions[:, columns] = values
        places, scale = operator.flat_indices_and_scale
        return np.asarray(motions.ravel()[places] / scale)

    def choose_step(self, stiffness: Array) -> float:
        """Return the default time step, s, for contacts with the normal ``stiffness`` (n_c,), N/m:
        :data:`_STEPS_PER_PERIOD` steps make the shortest period.

        Raises :class:`~granphon.base.errors.InputError` if nothing resists or slows down a motion,
        as where a ball touches none but its own images, and what :meth:`find_rate` raises.
        """
        rate = self.find_rate(stiffness)
        if not rate > 0.0:
            raise InputError(
                "no contact resists a motion of the balls", "There is no time scale", "Give a step"
            )
        return 2.0 * math.pi / _STEPS_PER_PERIOD / rate

    def find_rate(self, stiffness: Array) -> float:
        """Return the rate of :meth:`_bound_rates`, rad/s; raise
        :class:`~granphon.base.errors.InputError` if contacts with the ``stiffness`` (n_c,), N/m,
        are too stiff for double precision.
        """
        rate = self._bound_rates(stiffness)
        if not rate < math.inf:
            raise InputError(
                "contacts become too stiff for double precision", mend="Compare the units"
            )
        return rate

    def find_pressed_stiffness(
        self, x: Array, energy: float, force: float = 0.0, displacement: float = 0.0
    ) -> Array:
        """Return the stiffness (n_c,), N/m, that each contact of the network comes to, the normal
        one or that of a flat punch as wide as the contact if it is larger.

        Each contact is taken at its overlap at the start x (size,), or, if that is deeper, at the
        depth to which a ball of the kinetic ``energy``, J, a ``force``, N, or a ``displacement``,
        m, would press it. Under gravity the stiffness is at least that at rest. Raises
        :class:`~granphon.base.errors.InputError` for balls too fast, or too far away, for double
        precision.
        """
        normal = self.waves.normal
        motions = np.zeros(self.operator.indices.shape)
        self._spread(x, np.zeros(len(self.moved_bodies)), motions)
        e = measure_along(self.network, motions)
        if not (energy < math.inf and np.all(np.isfinite(e))):
            raise InputError(
                "balls are too fast, or too far away, for double precision",
                mend="Compare the units",
            )
        depth = np.maximum(self._find_depths(len(e), energy, force), displacement)
        stiffness = _find_stiffest(normal, np.minimum(-depth, e))
        if np.any(self.waves.gravity):  # balls that fall close contacts that are open at the start
            stiffness = np.maximum(stiffness, self.network.normal_stiffness)
        return stiffness

    def _find_depths(self, n_contacts: int, energy: float, force: float) -> Array:
        """Return for each of the ``n_contacts`` of the network the depth (n_c,), m, at which it has
        taken up an ``energy``, J, and bears a ``force``, N: the first such depth of a list that
        grows by :data:`_DEPTH_RATIO`, or the last depth of the list if there is none.
        """
        normal = self.waves.normal
        depths = _LEAST_DEPTH * self._mean_radius * _DEPTH_RATIO ** np.arange(float(_N_DEPTHS))
        # for all contacts at once by bisection between the indices low and high
        low = np.zeros(n_contacts, np.int16)
        is_pressed = energy > 0.0 or force > 0.0
        high = np.full(n_contacts, _N_DEPTHS - 1 if is_pressed else 0, np.int16)
        while np.any(low < high):
            middle = (low + high) // 2
            depth = depths[middle]
            is_shallow = normal.store(-depth) + normal.rest * depth < energy
            is_shallow |= normal.press(-depth)[0] < force
            low = np.where(is_shallow, middle + 1, low)
            high = np.where(is_shallow, high, middle)
        return np.asarray(depths[low])

    def _bound_rates(self, stiffness: Array) -> float:
        """Return the rate, rad/s, that bounds the time step for contacts with the normal
        ``stiffness`` (n_c,), N/m: a bound of the angular frequencies w, or twice a bound of the
        rates of losses g if that is larger.

        Dashpots slow motions down at the rate g = tau w^2, or c/m. A step h is stable for w h < 2
        and g h < 1, hence the factor two.
        """
        return max(
            self.bound.find(stiffness), 2.0 * self.bound.find_viscous(stiffness, self.waves.losses)
        )

    def integrate(
        self, x: Array, v: Array, schedule: _Schedule, scheme: str, recorder: Frames
    ) -> Iterator[bool]:
        """Run from mass-weighted motions x with velocities v (size,), let the ``recorder`` take a
        frame at each time of the ``schedule``, and yield after each frame: False after the first,
        which is the start, and True after all others.

        The ``scheme`` is "verlet" or "midpoint". Raises :class:`_Stop` when the run cannot go on,
        and :class:`~granphon.base.errors.InputError` as :meth:`_begin` does.
        """
        step = recorder.step
        steps_per_frame = schedule.steps_per_frame
        self._begin(x, v, step, scheme)
        self._keep_frame(0, recorder)
        yield False
        greatest_rate = 2.0 * math.pi / schedule.least_per_period / step
        # losses may have half of this rate, see :meth:`_bound_rates`
        allowed_stiffness = self.bound.find_allowed(
            greatest_rate, 0.5 * greatest_rate, self.waves.losses
        )
        for number in range(1, steps_per_frame * (schedule.n_frames - 1) + 1):
            if self.waves.geometry == "exact":
                next_strokes, _ = self._evaluate_drives(number * step)
                self._update_pairs(next_strokes)
            self._advance(number * step)
            is_frame = number % steps_per_frame == 0
            # most steps need no look at all contacts: none is stiff enough
            if is_frame or self.contacts.stiffest > allowed_stiffness:
                self._refresh()
                self._require_short(greatest_rate)
            if is_frame:
                self._keep_frame(number, recorder)
                yield True
                if self.waves.geometry == "lattice":
                    self._require_places()

    def _require_short(self, greatest_rate: float) -> None:
        """Raise :class:`_Stop` if the step is too long: if the present contacts, as
        :meth:`_refresh` has set them, may have a rate above ``greatest_rate``, rad/s, or if motions
        are not finite.
        """
        stiffness = np.maximum(self.current.k, self.current.punch)
        is_finite = np.all(np.isfinite(self.v)) and np.all(np.isfinite(self.current.e))
        if not (self._bound_rates(stiffness) <= greatest_rate and is_finite):
            raise _Stop(_LONG_STEP)

    def _require_places(self) -> None:
        """Raise :class:`_Stop` if a ball has left its place by :data:`_MOST_DISPLACEMENT` of the
        mean diameter.
        """
        displacements = self.operator.to_balls(self.x)[:, :3]
        largest_displacement = float(np.max(np.abs(displacements)))
        if not largest_displacement < _MOST_DISPLACEMENT * 2.0 * self._mean_radius:  # True for nan
            raise _Stop(
                f"a ball has left its place by {largest_displacement:.3g} m, which needs geometry:"
                f" exact"
            )

    def _begin(self, x: Array, v: Array, step: float, scheme: str) -> None:
        """Begin a run of a ``scheme`` with the time ``step``, s, at the time zero, from
        mass-weighted motions x with velocities v (size,), which are copied; all attributes of a run
        are set.

        Contacts come from rest to the start as :meth:`MovingContacts.begin` says. Raises
        the :class:`~granphon.base.errors.InputError` of :meth:`evaluate_start`.
        """
        # first, as what contacts set in a step depends on the scheme
        self._is_explicit = scheme == "verlet"
        no_balls = np.zeros(0, np.intp)
        # the pairs (i, j, shift) that may meet, each with the index of its contact
        self._keys: dict[tuple[int, ...], int] = {}
        self._set_contacts(no_balls, no_balls, np.zeros((0, 3), np.intp))
        self.x = x.copy()
        self.v = v.copy()
        self.step = step
        self.widest = 0.0
        self.strokes, self.drive_forces = self.evaluate_start()
        contacts = self.contacts
        rest_moment = contacts.make_moment()
        contacts.press(rest_moment, None)
        self._shear_energy_at_rest = contacts.shear_energy(rest_moment)
        self.current = contacts.make_moment()
        self._spread(self.x, self.strokes, self.current.motions)
        self.joined = contacts.begin(self.current)
        self._make_buffers()
        # pairs that may meet are put behind the contacts of the network, which keep the state that
        # they have by now; energies that follow are of all contacts
        if self.waves.geometry == "exact":
            self._list_pairs()
        self._shear_energy_at_start = self.contacts.shear_energy(self.current)
        self.energies = _Energies()
        # the speeds of drives are those of the last step, and no step was made yet
        self._set_accelerations(np.zeros_like(self.strokes))

    def _make_buffers(self) -> None:
        """Allocate the arrays into which a step is computed before it is made, and that of the
        speeds of all bodies, with which contacts are damped.
        """
        # an explicit step finds forces when it is made, not when it is tried: both moments share
        # the forces across contacts, which go on in place
        self._spare = self.contacts.make_spare(self.current, has_pull=not self._is_explicit)
        self._spare_x = np.empty_like(self.x)
        self._spare_v = np.empty_like(self.x)
        self._speeds = np.zeros_like(self.current.motions)

    def _set_accelerations(self, speeds: Array) -> None:
        """Set what a step begins with from the present state and the ``speeds`` of drives, m/s: the
        accelerations, which are also taken as those of the step before, and the forces that resist
        drives.
        """
        self._spread(self.v, speeds, self._speeds)
        self.contacts.act(self.current, self._speeds)
        self.acceleration = self._accelerate(
            self.contacts.on_balls, self._steady_push(self.drive_forces)
        )
        if self._has_drag:
            self.acceleration -= self._drag * self.v
        self.resistances = self._find_drive_resistance()
        self.last_acceleration = self.acceleration

    def _steady_push(self, drive_forces: Array) -> Array:
        """Return the mass-weighted accelerations (size,) by the load, weights and the
        ``drive_forces`` (drives,), N.
        """
        return self._steady + drive_forces @ self._push if len(drive_forces) else self._steady

    def _find_drive_resistance(self) -> Array:
        """Return for each drive that is a displacement the force, N, along its direction, with
        which contacts and the load resist it.
        """
        forces = self.contacts.still - self.contacts.on_balls if self._along else _NO_NUMBERS
        resistances = [np.sum(forces[balls, : len(along)] @ along) for balls, along in self._along]
        return np.array(resistances)

    def _refresh(self) -> None:
        """Set the elongations, normal forces and stiffnesses of the present contacts if compiled
        loops know the law: the steps of such a run leave them unset, and other steps set them.
        """
        if self._knows_law:
            self.contacts.measure(self.current)
            self.contacts.press(self.current, self.joined)

    def _advance(self, end: float) -> None:
        """Make a step that ends at the time ``end``, s; in parts if contacts join or part within
        the step.

        Raises :class:`_Stop` if a contact joins or parts too many times, and as :meth:`_try_step`
        does.
        """
        remaining_time = self.step
        has_jumps = len(self.contacts.law.jumps) > 0
        n_switches: Index = np.zeros(len(self.current.e) if has_jumps else 0, np.intp)
        while remaining_time > 0.0:
            trial = self._try_step(remaining_time, end)
            if has_jumps and self._find_overshoot(trial.end_moment) > 0.0:
                trial = self._cut_to_switch(trial, end)
            speeds = (trial.strokes - self.strokes) / trial.step
            last_moment = self.current
            if len(trial.drive_forces):
                mean_drive_forces = 0.5 * (self.drive_forces + trial.drive_forces)
                # displacements of the pushed balls, summed for each force
                displacements = trial.step * (self._push @ trial.drift)
                self.energies.work += float(mean_drive_forces @ displacements)
            if self._is_explicit:
                self._finish_verlet(trial, speeds)
            else:
                self._finish_midpoint(trial)
            self._spare = last_moment  # its arrays are free for the next step
            self.strokes = trial.strokes
            self.drive_forces = trial.drive_forces
            remaining_time -= trial.step
            if has_jumps and self._find_overshoot(self.current) > 0.0:
                self.joined, contacts, loss = self.contacts.switch(self.current, self.joined)
                self.energies.jumps += loss
                self._set_accelerations(speeds)
                n_switches[contacts] += 1
                if np.max(n_switches) > _MOST_SWITCHES:
                    raise _Stop(_RATTLE)

    def _find_overshoot(self, moment: Moment) -> float:
        """Return the greatest distance, m, by which a contact of the ``moment`` has passed the
        elongation at which it joins or parts; below zero if none has.
        """
        return float(np.max(self.contacts.pass_ends(moment.e, self.joined)))

    def _cut_to_switch(self, trial: _Trial, end: float) -> _Trial:
        """Return a trial of the first part of the step of a ``trial`` that ends at the time
        ``end``, s: just after the first contact has joined or parted.

        The end of this part is found by the rule of false position (the Illinois method), to the
        share :data:`_SWITCH_SHARE` of the step. The given trial may not be used any more, as its
        arrays are overwritten.
        """
        whole_step = trial.step
        start = end - whole_step
        low = 0.0
        high = whole_step
        last_side = 0  # 1 or -1 if the last middle became the high or the low end
        low_overshoot = self._find_overshoot(self.current)
        high_overshoot = self._find_overshoot(trial.end_moment)
        tolerance = _SWITCH_SHARE * self.step
        while high - low > tolerance:
            middle = low - low_overshoot * (high - low) / (high_overshoot - low_overshoot)
            middle = min(max(middle, low + 0.5 * tolerance), high - 0.5 * tolerance)
            trial_to_middle = self._try_step(middle, start + middle)
            overshoot = self._find_overshoot(trial_to_middle.end_moment)
            if overshoot > 0.0:
                high = middle
                high_overshoot = overshoot
                # the same end twice: the method halves the value at the other end
                low_overshoot *= 0.5 if last_side == 1 else 1.0
                last_side = 1
            else:
                low = middle
                low_overshoot = overshoot
                high_overshoot *= 0.5 if last_side == -1 else 1.0
                last_side = -1
        # tried again, as the arrays are those of the last trial; a rest of the step too short to be
        # a step of its own is added
        if whole_step - high < tolerance:
            return self._try_step(whole_step, end)
        return self._try_step(high, start + high)

    def _try_step(self, step: float, end: float) -> _Trial:
        """Return the trial of a ``step``, s, of the scheme of the run that ends at the time
        ``end``, s. The step begins at the present state, which stays as it is.

        The next trial overwrites the arrays of this one. Raises :class:`_Stop` if an implicit step
        has no solution, or a drive is no finite number at ``end``.
        """
        strokes, drive_forces = self._evaluate_drives(end)
        if not self._is_explicit:
            return self._solve_midpoint(step, strokes, drive_forces)
        moment = self._drift(step, strokes, self.acceleration)
        return _Trial(step, strokes, drive_forces, self._spare_x, self._spare_v, moment)

    def _drift(self, step: float, strokes: Array, acceleration: Array) -> Moment:
        """Compute in spare arrays where balls come to in a ``step``, s, with a constant
        ``acceleration`` (size,), and the mean velocity of balls; driven bodies come to ``strokes``,
        m.

        Return the contacts there, with the motions of balls. Their elongations are set unless
        compiled loops know the law.
        """
        moment = self._spare
        drift(self.x, self.v, acceleration, step, self._spare_x, self._spare_v)
        self._spread(self._spare_x, strokes, moment.motions)
        if not self._knows_law:
            self.contacts.measure(moment)
        return moment

    def _finish_verlet(self, trial: _Trial, speeds: Array) -> None:
        """Make the step of Verlet's scheme that was tried last, with drives at these ``speeds``,
        m/s: set the state and the accelerations at its end, and add to the energies.
        """
        contacts = self.contacts
        start = self.current
        end = trial.end_moment
        half = 0.5 * trial.step
        self.x, self._spare_x = trial.x, self.x
        self.v, self._spare_v = trial.drift, self.v
        if contacts.is_damped:
            # the velocity at the end of the step, by the acceleration at its beginning
            end_velocity = self.v + half * self.acceleration
            self._spread(end_velocity, speeds, self._speeds)
        if not self._knows_law:
            contacts.press(end, self.joined)
        friction, damping = contacts.follow(start, end, self._knows_law, self._speeds)
        self.current = end
        self.energies.friction += friction
        self.energies.damping += damping
        steady = self._steady_push(trial.drive_forces)
        gather(contacts.on_balls, self._places, self._scale, steady, self.acceleration)
        if self._has_drag:
            self.energies.damping += trial.step * float(self._drag @ self.v**2)
            self._slow_down(self.acceleration, self.v, half)
        resistances = self._find_drive_resistance()
        mean_resistances = 0.5 * (self.resistances + resistances)
        self.energies.work += float(mean_resistances @ (trial.strokes - self.strokes))
        self.resistances = resistances
        kick(self.v, self.acceleration, half)

    def _solve_midpoint(self, step: float, strokes: Array, drive_forces: Array) -> _Trial:
        """Return the trial of an implicit ``step``, s, whose energies add up, with ``strokes``, m,
        and ``drive_forces``, N, of drives at its end.

        The mean acceleration is found by iteration; the first guess goes on linearly from the last
        two steps. Raises :class:`_Stop` if the iteration does not converge.
        """
        contacts = self.contacts
        steady = self._steady_push(0.5 * (self.drive_forces + drive_forces))
        guess = 2.0 * self.acceleration - self.last_acceleration
        change = math.inf
        for _ in range(_MOST_ITERATIONS):
            moment = self._drift(step, strokes, guess)
            contacts.press(moment, self.joined)
            friction, damping = contacts.follow_mean(self.current, moment, self.joined, step)
            acceleration = self._accelerate(contacts.on_balls, steady)
            if self._has_drag:
                damping += step * float(self._drag @ self._spare_v**2)
                self._slow_down(acceleration, self.v, 0.5 * step)
            last_change = change
            change = float(np.max(np.abs(acceleration - guess)))
            size = max(float(np.max(np.abs(acceleration))), float(np.max(np.abs(self.v))) / step)
            is_rounding = (
                last_change <= change <= _CHANGE_BY_ROUNDING * size
            )  # small, and no longer falls
            if change <= _CHANGE_OF_SOLUTION * size or is_rounding:
                return _Trial(
                    step=step,
                    strokes=strokes,
                    drive_forces=drive_forces,
                    x=self._spare_x,
                    drift=self._spare_v,
                    end_moment=moment,
                    acceleration=guess,  # the one with which balls have come to the moment
                    friction=friction,
                    damping=damping,
                    resistances=self._find_drive_resistance(),
                )
            guess = acceleration
        raise _Stop(_NO_SOLUTION)

    def _slow_down(self, acceleration: Array, v: Array, span: float) -> None:
        """Add drag to an ``acceleration`` (size,), in place: that of the velocity which balls with
        the velocity ``v`` (size,) have after a ``span``, s, in which the drag acts as well.
        """
        acceleration -= self._drag * (v + span * acceleration) / (1.0 + span * self._drag)

    def _finish_midpoint(self, trial: _Trial) -> None:
        """Make the implicit step that was tried last: set the state at its end, and add to the
        energies.
        """
        self.last_acceleration = self.acceleration
        self.acceleration = trial.acceleration
        self.current = trial.end_moment
        self.x, self._spare_x = trial.x, self.x
        kick(self.v, trial.acceleration, trial.step)
        self.energies.friction += trial.friction
        self.energies.damping += trial.damping
        self.energies.work += float(trial.resistances @ (trial.strokes - self.strokes))

    def _keep_frame(self, number: int, recorder: Frames) -> None:
        """Let the ``recorder`` take the frame of the present state, after this ``number`` of steps,
        and update ``widest``: the greatest ratio, in all frames so far, of the radius of a contact
        to that of its smaller ball.

        Elongations and normal forces must be the present ones, see :meth:`_refresh`.
        """
        moment = self.current
        normal = self.contacts.law
        widths = self._width_ratio * np.sqrt(np.maximum(normal.overlap - moment.e, 0.0))
        self.widest = max(self.widest, float(np.max(widths, initial=0.0)))
        displacements, rotations = np.split(self._find_motions(), 2, axis=1)
        speeds, spins = np.split(self.operator.to_balls(self.v), 2, axis=1)
        if self._stroke_functions:
            drive_speeds = self._find_drive_speeds(number)
            for (balls, direction), speed in zip(self.moved_bodies, drive_speeds, strict=True):
                speeds[balls] = speed * direction
        is_closed = normal.is_closed(moment.e, self.joined)
        frame = {
            "times": number * self.step,
            "displacements": displacements,
            "velocities": speeds,
            "rotations": rotations,
            "spins": spins,
            **self._sum_energies(),
        }
        recorder.keep(
            frame,
            np.where(is_closed, moment.pull[0] + normal.rest, 0.0),
            self.contacts.shears(moment),
            list(self._keys),
        )

    def _sum_energies(self) -> dict[str, float]:
        """Return the present energies, J, that a frame keeps, by the names of the fields of
        :class:`~granphon.waves.motion.Motion`.
        """
        moment = self.current
        contacts = self.contacts
        is_rotation = self.operator.is_rotation
        squares = self.v * self.v
        shear_energy = contacts.shear_energy(moment)
        stored = (
            float(np.sum(contacts.law.store(moment.e, self.joined)))
            + shear_energy
            - self._shear_energy_at_rest
            - float(self._weight @ self.x)
        )
        # contacts still store a part of the energy that slip has taken up
        friction_loss = self.energies.friction - (shear_energy - self._shear_energy_at_start)
        return {
            "translation": 0.5 * float(np.sum(squares[~is_rotation])),
            "rotation": 0.5 * float(np.sum(squares[is_rotation])),
            "stored": stored + contacts.rest_energy(moment),
            "lost": friction_loss + self.energies.damping + self.energies.jumps,
            "work": self.energies.work,
        }

    def _find_drive_speeds(self, number: int) -> Array:
        """Return the speed, m/s, of each displacement of a drive after this ``number`` of steps:
        central differences over two steps.

        Differences are one-sided at the start, and also if a drive is no finite number one step
        later, as it may end with the run.
        """
        time = number * self.step
        start, _ = self._evaluate_drives(max(time - self.step, 0.0))
        n_steps = 2 if number else 1
        try:
            end, _ = self._evaluate_drives(time + self.step)
        except _Stop:
            end = self.strokes  # those of the present time
            n_steps = 1
        return (end - start) / (n_steps * self.step)

    def evaluate_start(self) -> tuple[Array, Array]:
        """Return the displacements, m, and the forces, N, of all drives at the time zero.

        Raises :class:`~granphon.base.errors.InputError` for a drive whose displacement is not zero
        then, or that is not finite.
        """
        strokes, drive_forces = self._evaluate_drives(0.0)
        if np.any(strokes):
            raise InputError(
                "a displacement does not begin at zero", mend="Give a function that is zero at zero"
            )
        return strokes, drive_forces

    def _evaluate_drives(self, time: float) -> tuple[Array, Array]:
        """Return the displacements, m, and the forces, N, of all drives at a ``time``, s.

        Raises :class:`_Stop` for a number that is not finite; at the time zero
        :class:`~granphon.base.errors.InputError`.
        """
        if not self.drives:
            return _NO_NUMBERS, _NO_NUMBERS
        strokes = np.array(
            [real_number(displacement(time)) for displacement in self._stroke_functions]
        )
        drive_forces = np.array([real_number(force(time)) for force in self._force_functions])
        if not (np.all(np.isfinite(strokes)) and np.all(np.isfinite(drive_forces))):
            fault = f"a drive is not a finite number at {time:.4g} s"
            if time:
                raise _Stop(fault)
            raise InputError(fault, mend="Give a function of the time that returns one")
        return strokes, drive_forces

    def _find_motions(self) -> Array:
        """Return the present displacements, m, and rotations, rad, (n, 6) of all balls and
        bodies.
        """
        motions = self.operator.to_balls(self.x)
        for (balls, direction), stroke in zip(self.moved_bodies, self.strokes, strict=True):
            motions[balls, :3] = stroke * direction
        return motions

    def _update_pairs(self, strokes: Array) -> None:
        """List anew the pairs that may meet, before a step that moves driven bodies to ``strokes``,
        m, if a ball has moved by more than :data:`_LISTED_SHARE` times the margin since they were
        listed. Displacements are measured only when their bound is above half of the margin.

        Raises :class:`_Stop` if balls without a law have met.
        """
        from scipy.linalg.blas import idamax

        for contacts, reason in self._unknown_groups:
            if np.any(self.current.e[contacts] < 0.0):
                raise _Stop(reason)
        # a bound of all speeds: the largest of three components over the root of the least mass
        speed = math.sqrt(3.0) * abs(float(self.v[idamax(self.v)])) / self._least_root_mass
        self._travelled += self.step * speed
        self._travelled += float(np.max(np.abs(strokes - self.strokes), initial=0.0))
        if self._travelled > 0.5 * self._skin:  # the bound adds up all steps: now it is measured
            positions = self.network.positions + self._find_motions()[:, :3]
            displacements = positions - self._listed_positions
            self._travelled = math.sqrt(np.max(np.sum(displacements**2, axis=1)))
            if self._travelled > _LISTED_SHARE * self._skin:
                self._list_pairs()

    def _list_pairs(self) -> None:
        """List the pairs that may meet at the present positions, and make their contacts if the
        list has changed; contacts that are listed again keep their state.
        """
        self._travelled = 0.0
        self._listed_positions = self.network.positions + self._find_motions()[:, :3]
        table = self._find_pairs(self._listed_positions)
        n = self.network.n_contacts
        keys = [tuple(key) for key in table.tolist()]
        if set(keys) == set(self._keys):
            return
        # the index that the contact of each pair had until now, or -1
        old_numbers = np.array([self._keys.get(key, -1) for key in keys], np.intp)
        self._keys = {key: n + place for place, key in enumerate(keys)}
        old_dash = self.contacts.dash
        self._set_contacts(table[:, 0], table[:, 1], table[:, 2:])
        is_old = old_numbers >= 0
        self._carry_over(np.flatnonzero(is_old), old_numbers[is_old], old_dash)

    def _find_pairs(self, positions: Array) -> Index:
        """Return the pairs (n_p, 5) that may meet, each once as (i, j, shift), when bodies are at
        ``positions`` (n, 3), m: two balls, or a ball i and a flat wall j.

        A ball and a wall are listed if their gap is below the margin. Two balls are listed up to a
        gap that is wider by :attr:`_extra_overlap`, if that is above zero, as they begin to push
        that far apart. Contacts of the network, and pairs of two bodies that are held, are not
        among the pairs.
        """
        network = self.network
        radii = network.radii
        balls = np.flatnonzero(np.isfinite(radii))  # without flat walls
        periods = network.cell[list(network.pbc)]
        margin_of_balls = self._skin + max(self._extra_overlap, 0.0)
        reach = 2.0 * float(np.max(radii[balls])) + margin_of_balls
        i, j, cells, vectors = find_pairs(positions[balls], periods, reach)
        i = balls[i]
        j = balls[j]
        is_near = np.linalg.norm(vectors, axis=1) < radii[i] + radii[j] + margin_of_balls
        i = i[is_near]
        j = j[is_near]
        shift = np.zeros((len(i), 3), np.intp)
        shift[:, list(network.pbc)] = cells[is_near]
        pairs = np.concatenate([np.column_stack([i, j, shift]), self._find_wall_pairs(positions)])
        has_moving_body = np.any(network.moving[pairs[:, :2]], axis=1)
        # a pair that is also a contact of the network has one row, the first of which is a contact
        rows = np.concatenate([self._list_contacts_as_pairs(), pairs[has_moving_body]])
        table, first_rows = np.unique(rows, axis=0, return_index=True)
        return np.asarray(table[first_rows >= network.n_contacts])

    def _find_wall_pairs(self, positions: Array) -> Index:
        """Return the pairs (k, 5) of a ball and a flat wall whose gap is below the margin, as
        (i, j, shift) with the ball i, the wall j and no shift, when bodies are at ``positions``
        (n, 3), m.
        """
        network = self.network
        balls = np.flatnonzero(np.isfinite(network.radii))
        pairs = [np.zeros((0, 5), np.intp)]
        for wall, (point, toward) in network.walls.items():
            displacement = positions[wall] - network.positions[wall]
            gaps = (point + displacement - positions[balls]) @ toward - network.radii[balls]
            near_balls = balls[gaps < self._skin]
            wall_pairs = np.zeros((len(near_balls), 5), np.intp)
            wall_pairs[:, 0] = near_balls
            wall_pairs[:, 1] = wall
            pairs.append(wall_pairs)
        return np.concatenate(pairs)

    def _list_contacts_as_pairs(self) -> Index:
        """Return the contacts (n_c, 5) of the network as :meth:`_find_pairs` writes pairs, (i, j,
        shift): reversed if pairs begin with the other ball, and without a shift to a flat wall,
        which has none.
        """
        network = self.network
        is_flat = np.isinf(network.distance)
        contacts = np.column_stack(
            [network.i, network.j, np.where(is_flat[:, None], 0, network.shift)]
        )
        is_reversed = ~(select_once(network.i, network.j, network.shift) | is_flat)
        reversed_contacts = np.column_stack([network.j, network.i, -network.shift])
        contacts[is_reversed] = reversed_contacts[is_reversed]
        return contacts

    def _carry_over(self, old_pairs: Index, old_numbers: Index, old_dash: Array) -> None:
        """Give the contacts that :meth:`_set_contacts` has just made the state that they had among
        the old contacts. Old are the contacts of the network, and the ``old_pairs`` (k,), numbered
        from zero, whose contacts had the indices ``old_numbers`` (k,).

        ``old_dash`` (rows, old n_c) are the forces of the old dashpots. Pairs that are new have no
        forces. Spare arrays are made anew.
        """
        contacts = self.contacts
        n = self.network.n_contacts
        old = self.current
        old_joined = self.joined
        self.current = contacts.make_moment()
        self.current.motions[:] = old.motions
        contacts.measure(self.current)
        joined = contacts.law.begin(self.current.e)
        if joined is not None and old_joined is not None:
            joined[:n] = old_joined[:n]
            joined[n + old_pairs] = old_joined[old_numbers]
        self.joined = joined
        forces_and_old_forces = [(self.current.pull, old.pull)]
        if contacts.is_damped:
            forces_and_old_forces.append((contacts.dash, old_dash))
        for forces, old_forces in forces_and_old_forces:
            forces[:] = 0.0
            forces[:, :n] = old_forces[:, :n]
            forces[:, n + old_pairs] = old_forces[:, old_numbers]
        contacts.press(self.current, joined)
        self._make_buffers()
