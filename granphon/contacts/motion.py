"""Contacts whose balls move: how they deform, what forces they then have, and how these act on the
balls, in the directions of rest or in the true ones.

Slip, twist and rolling s are resisted by forces T whose stiffness is in proportion to that of a
flat punch as wide as the contact, k_t = eta 2 E* a(h), which without adhesion is the normal
stiffness k: dT = k_t ds while a rises, and the elastic part T/k_t is kept while a falls. Slip ends
at Coulomb's limit |T| <= mu f, of the force f of the law. It is the law of
:mod:`granphon.contacts.friction`.

Dashpots add c times the rate of an elongation, c = tau k(h) + c_0 + alpha (m* k(h))^1/2 as long as
the contact is closed. The term in tau is by G. Kuwabara and K. Kono, Jpn. J. Appl. Phys. 26, 1230,
1987; for the others see :mod:`granphon.dynamics.damping`. Slip is resisted by c' = tau' k_t(h) +
c_0' + alpha (m* k(h))^1/2 in the same way, and twist and roll by c'/k_t times their stiffnesses.
The dashpot of an elongation pulls where balls part; it may be limited to the force f of the law, so
that both together never pull. Coulomb's limit is then that of T and f, or that of T and f with the
forces of their dashpots, |T + c' s'| <= mu |f + c h'|: as in LAMMPS.

Loops over contacts are those of :mod:`granphon.contacts.motion_loops`. Where all normal forces are
Hertz's, the loops know the law; other laws are asked between two loops.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from granphon.balls import hertz
from granphon.base.arrays import Array, Index
from granphon.contacts import motion_loops as loops
from granphon.contacts.motion_laws import PairLaws, Powers
from granphon.contacts.motion_loops import Columns, Moment, Rules, Step
from granphon.dynamics.damping import Losses
from granphon.networks.network import ContactNetwork

#: number of components of the force across a contact against slip
_N_SLIPS = 3
#: number of rows of a pull without torques: the normal force, then those against slip
_ROWS_OF_SLIP = 1 + _N_SLIPS


class MetPairs(NamedTuple):
    """Pairs that may meet, beside the contacts of a network: two balls, or a ball i and a flat wall
    j.

    Attributes
    ----------
    i, j : (n_p,) numbers of the two bodies.
    shift : (n_p, 3) whole periods by which body j is displaced.
    slip_ratio : (n_p,) stiffness of slip over that of a flat punch as wide as the contact.
    bulge : length, m: two balls begin to push where their distance is the sum of their radii and
        this length. A ball and a wall do so where their distance is the radius.
    """

    i: Index
    j: Index
    shift: Index
    slip_ratio: Array
    bulge: float


class _Geometry(NamedTuple):
    """Contacts at rest, with the r of :mod:`granphon.contacts.motion_loops`.

    Attributes
    ----------
    r : (n_c, 3) r at rest: a vector, m, where contacts turn, and a unit vector elsewhere.
    length : (n_c,) length of r.
    gap : (n_c,) distance, m, by which balls of pairs that may meet have to approach before they
        push; zero of contacts.
    is_free : (n_c,) one where r follows the balls, and zero where r stays.
    arm_i, arm_j : (n_c,) arms of balls i and of balls j over the length of r: parts of a vector, or
        lengths, m, of a unit vector.
    levers : (2, n_c) radii of balls i and of balls j where these are the levers of slip, m, in
        place of the arms; else zero.
    """

    r: Array
    length: Array
    gap: Array
    is_free: Array
    arm_i: Array
    arm_j: Array
    levers: Array


class MovingContacts:
    """The contacts of balls in motion.

    Motions of balls, and forces on them, are (n, m), for the m motions of each ball.

    Parameters
    ----------
    network : the balls at rest, and their contacts.
    pairs : pairs of balls that may meet, whose contacts come behind those of the network; there
        must be none if contacts keep the directions of rest.
    law : the law of the normal forces of all contacts.
    punch : (n_c,) stiffnesses, above zero, of flat punches as wide as the contacts of the network
        at rest, N/m.
    losses : the losses of the network.
    rules : choices that hold for all contacts.

    Attributes
    ----------
    axes : (m,) axes of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations.
    ratios : (rows - 1, n_c) stiffnesses against slip (3), twist and rolling (3) over those of flat
        punches; rows is 4, or 8 with twist and rolling.
    rest_forces : (rows - 1, n_c) forces across contacts at rest.
    springs : (n, m) stiffnesses of springs to the ground; None without such springs.
    on_balls : (n, m) forces of contacts, their dashpots, and springs to the ground on balls, set by
        each step.
    still : (n, m) the same forces at rest.
    dash : (rows, n_c) forces of dashpots, set by each step with dashpots; (rows, 0) without any.
    stiffest : greatest stiffness of a contact, or of a flat punch as wide, after the last step,
        N/m.
    is_damped : whether there are dashpots.
    is_hertz : whether all normal forces are Hertz's, which loops know.
    """

    def __init__(
        self,
        network: ContactNetwork,
        pairs: MetPairs,
        law: Powers | PairLaws,
        punch: Array,
        losses: Losses,
        rules: Rules,
    ) -> None:
        """Gather the columns of all contacts, and find the forces at rest by a step without motion:
        it sets :attr:`on_balls`, :attr:`stiffest` and :attr:`still`.
        """
        self.law = law
        self.rules = rules
        self.axes = _list_axes(network)
        self.is_damped = losses.has_dashpots
        self.springs: Array | None = None
        if network.on_site is not None:
            self.springs = network.on_site[:, : len(self.axes)]
        self.is_hertz = isinstance(law, Powers) and law.exponent == hertz.EXPONENT
        self.ratios = _find_ratios(network, pairs, punch)
        self.rest_forces = _find_rest_forces(network, self.ratios.shape)
        geometry = (
            _find_true_geometry(network, pairs) if rules.can_turn else _find_geometry(network)
        )
        columns = _list_columns(geometry, law, self.ratios, self.is_hertz)
        dashpots = losses.list_dashpots(pairs.i, pairs.j)
        columns |= dict(zip(loops.DASHPOTS, dashpots, strict=True))
        ends = (np.append(network.i, pairs.i), np.append(network.j, pairs.j))
        self._columns = _make_columns(ends, self.axes, columns)
        self.on_balls = np.zeros((network.n_balls, len(self.axes)))
        n_rows = len(self.ratios) + 1
        self._no_mean = np.zeros(0)
        self._no_speeds = np.zeros((0, len(self.axes)))
        self._no_dash = np.zeros((n_rows, 0))
        self.dash = np.zeros((n_rows, len(ends[0]))) if self.is_damped else self._no_dash
        # forces of contacts on balls at rest, by a step without motion, which sets `pull`
        rest = self.make_moment()
        self._advance(rest, rest._replace(pull=rest.pull.copy()), self._stick)
        self.still = self.on_balls.copy()

    @property
    def _stick(self) -> Rules:
        """The rules of the contacts, but that no contact slides."""
        return self.rules._replace(mu=math.inf)

    def make_moment(self) -> Moment:
        """Return the moment of rest: no motions, and the forces across contacts at rest.
        Stiffnesses are ones, which the caller has to replace; ``punch`` is the array ``k`` itself
        if the law does not know the radii of contacts.
        """
        n_contacts = len(self._columns.i)
        pull = np.concatenate([np.zeros((1, n_contacts)), self.rest_forces])
        k = np.ones(n_contacts)
        # a law that does not know radii takes the normal stiffness for that of a punch
        punch = np.ones(n_contacts) if self.law.has_radii else k
        return Moment(np.zeros_like(self.on_balls), np.zeros(n_contacts), pull, k, punch)

    def make_spare(self, moment: Moment, has_pull: bool) -> Moment:
        """Return a new moment whose arrays have the shapes of those of ``moment``; the caller has
        to set their values. ``pull`` is a new array if ``has_pull``, and otherwise the array of
        ``moment``.
        """
        k = np.empty_like(moment.k)
        return Moment(
            np.zeros_like(moment.motions),
            np.empty_like(moment.e),
            np.empty_like(moment.pull) if has_pull else moment.pull,
            k,
            np.empty_like(k) if self.law.has_radii else k,
        )

    def measure(self, moment: Moment) -> None:
        """Set the elongations ``e`` of a ``moment`` from its motions."""
        loops.measure(self._columns, moment.motions, self.rules.can_turn, moment.e)

    def press(self, moment: Moment, is_joined: Any) -> None:
        """Set the changes f - f_0 of normal forces, and the stiffnesses, of a ``moment`` from its
        elongations.

        ``is_joined`` (n_c,) says which contacts whose force jumps are joined, None that all are:
        see :meth:`Powers.press`. Stiffnesses of punches are set if the law knows radii; otherwise
        they are the normal stiffnesses, in the same array.
        """
        self.law.press(moment.e, (moment.pull[0], moment.k), is_joined)
        if isinstance(self.law, PairLaws) and self.law.has_radii:
            self.law.punch(moment.e, moment.punch, is_joined)

    def begin(self, moment: Moment) -> Any:
        """Set all of a ``moment`` but its motions, as if balls had come to these motions from rest
        in one step; return which contacts (n_c,) are joined, None if no force jumps.

        In the step contacts are as stiff as at its end, and forces across contacts stay within
        Coulomb's limit. The step also sets :attr:`on_balls` and :attr:`stiffest`.
        """
        self.measure(moment)
        is_joined = self.law.begin(moment.e)
        self.press(moment, is_joined)
        at_rest = self.make_moment()._replace(k=moment.k, punch=moment.punch)
        self._advance(at_rest, moment, self.rules)
        return is_joined

    def act(self, moment: Moment, speeds: Array) -> None:
        """Set :attr:`on_balls` to the forces at a ``moment``, with those of dashpots at the
        ``speeds`` (n, m) of the balls; also set :attr:`dash` and :attr:`stiffest`. The moment is
        not changed.
        """
        # a step without motion
        after = moment._replace(pull=moment.pull.copy())
        self._advance(moment, after, self._stick, speeds=speeds)

    def follow(
        self, before: Moment, after: Moment, is_hertz: bool, speeds: Array
    ) -> tuple[float, float]:
        """Set the forces across contacts ``after`` a step, and :attr:`on_balls` to the forces after
        it, with those of dashpots at the ``speeds`` (n, m) after it. Return the energy, J, that
        slip, twist and roll take up in the step, and that which dashpots take up.

        The moment ``after`` has to have its motions, and unless ``is_hertz`` also its elongations,
        normal forces and stiffnesses. If ``is_hertz``, loops find these by Hertz's law and do not
        set them; the caller may ask for this if :attr:`is_hertz` is true.
        """
        return self._advance(before, after, self.rules._replace(is_hertz=is_hertz), speeds=speeds)

    def follow_mean(
        self, before: Moment, after: Moment, is_joined: Any, step: float
    ) -> tuple[float, float]:
        """Set the forces across contacts ``after`` a ``step``, s, and :attr:`on_balls` to the mean
        forces of the step, by which it keeps the energy. Return the energy, J, that slip, twist and
        roll take up in the step, and that which dashpots take up. ``is_joined`` (n_c,) is that of
        :meth:`press`; both moments are complete but for the forces across contacts ``after``.
        """
        mean = self.law.mean(before.e, after.e, is_joined)
        return self._advance(before, after, self.rules, mean=mean, step=step)

    def _advance(
        self,
        before: Moment,
        after: Moment,
        rules: Rules,
        *,
        mean: Array | None = None,
        speeds: Array | None = None,
        step: float = 0.0,
    ) -> tuple[float, float]:
        """Take contacts from the moment ``before`` to the moment ``after`` by ``rules``, and return
        the two energies of :meth:`follow`.

        ``mean``, ``speeds`` and the length ``step``, s, are those of
        :class:`~granphon.contacts.motion_loops.Step`. If both ``mean`` and ``speeds`` are None,
        dashpots do not act. Sets :attr:`on_balls` and :attr:`stiffest`, and :attr:`dash` if
        dashpots act.
        """
        has_dash = speeds is not None or mean is not None
        inputs = Step(
            step,
            self._no_mean if mean is None else mean,
            self._no_speeds if speeds is None else speeds,
            self.dash if has_dash else self._no_dash,
        )
        side_energy, dashpot_energy, self.stiffest = loops.follow(
            self._columns, rules, before, after, inputs, self.on_balls
        )
        if self.springs is not None:
            # the mean of a linear force over the step is the mean of the forces at its two ends
            motions = after.motions if mean is None else 0.5 * (before.motions + after.motions)
            self.on_balls -= self.springs * motions
        if not rules.is_hertz:  # by Hertz's law, normal stiffnesses are those of punches
            self.stiffest = max(self.stiffest, float(np.max(after.k, initial=0.0)))
        return side_energy, dashpot_energy

    def rest_energy(self, moment: Moment) -> float:
        """Return the part, J, of the energy at a ``moment`` that the laws of contacts do not count:
        that of the loads which hold the balls at rest, and that of springs to the ground.

        The energy of a law contains that of a load f_0 along its contact. Where directions turn,
        the balls are held by other loads, which do not turn: the energies of the loads f_0 are
        subtracted.
        """
        energy = float(np.sum(self.still * moment.motions))
        if self.springs is not None:
            energy += 0.5 * float(np.sum(self.springs * moment.motions**2))
        if self.rules.can_turn:
            energy -= float(np.sum(self.law.rest * moment.e))
        return energy

    def shear_energy(self, moment: Moment) -> float:
        """Return the energy, J, that all contacts together store by slip, twist and rolling at a
        ``moment``: the sum of T^2/2k_t over all forces and torques T with a stiffness k_t above
        zero.
        """
        forces = moment.pull[1:]
        double_stiffness = 2.0 * self.ratios * moment.punch
        is_closed = double_stiffness > 0.0
        energies = np.divide(
            forces * forces, double_stiffness, out=np.zeros_like(forces), where=is_closed
        )
        return float(np.sum(energies))

    def shears(self, moment: Moment) -> Array:
        """Return the magnitudes (n_c,) of the forces across contacts at a ``moment``, N."""
        return np.asarray(np.sqrt(np.sum(moment.pull[1:_ROWS_OF_SLIP] ** 2, axis=0)))

    def pass_ends(self, e: Array, is_joined: Any) -> Array:
        """Return how far (n_jumps,), m, each contact whose force jumps has passed its end at
        elongations e (n_c,), m: see :meth:`PairLaws.pass_ends`; (0,) if no force jumps.
        """
        if isinstance(self.law, PairLaws):
            return self.law.pass_ends(e, is_joined)
        return np.zeros(0)

    def switch(self, moment: Moment, was_joined: Any) -> tuple[Any, Index, float]:
        """Join or part the contacts of a ``moment`` that have passed their ends, of a law with
        forces that jump; ``was_joined`` (n_c,) says which are joined before, and is not changed.

        Return which contacts (n_c,) are joined after that, the numbers of those that have joined or
        parted, and the energy lost, J. In the moment, the forces across contacts that have joined
        or parted are set to zero, and all normal forces and stiffnesses are set anew.
        """
        law = self.law
        has_passed = self.pass_ends(moment.e, was_joined) > 0.0
        switched_contacts = law.jumps[has_passed]
        is_joined = was_joined.copy()
        is_joined[switched_contacts] = ~is_joined[switched_contacts]
        moment.pull[1:, switched_contacts] = 0.0
        self.press(moment, is_joined)
        energy_before = law.store(moment.e, was_joined)[switched_contacts]
        energy_after = law.store(moment.e, is_joined)[switched_contacts]
        return is_joined, switched_contacts, float(np.sum(energy_before - energy_after))


def measure_along(network: ContactNetwork, motions: Array) -> Array:
    """Return the elongations (n_c,), m, of the contacts of a ``network``, at least one, along their
    directions at rest, if its balls have moved by ``motions`` (n, m) since rest.
    """
    r = network.normal
    directions = {loops.REST + axis * loops.CHUNK: r[:, axis] for axis in range(3)}
    columns = _make_columns((network.i, network.j), _list_axes(network), directions)
    e = np.empty(network.n_contacts)
    loops.measure(columns, motions, False, e)
    return e


def _list_axes(network: ContactNetwork) -> Index:
    """Return the axes (m,) of the motions of a ball: 0 to 2 of displacements, 3 to 5 of
    rotations.
    """
    motions = network.ball_motions
    return np.array([*motions.translations, *(3 + axis for axis in motions.rotations)])


def _find_rest_forces(network: ContactNetwork, shape: tuple[int, ...]) -> Array:
    """Return the forces across contacts at rest, in an array of this ``shape`` (3 or 7, n_c):
    against slip (3) and, with 7 rows, torques against twist and against roll (3); zero for pairs
    that may meet.

    The static force and torque of a contact are those on ball j; the forces and torques that resist
    slip, twist and roll have the opposite sign.
    """
    forces = np.zeros(shape)
    n_contacts = network.n_contacts
    if network.tangential_force is not None:
        forces[:_N_SLIPS, :n_contacts] = -network.tangential_force.T
    if network.contact_torque is not None and len(forces) > _N_SLIPS:
        twist = np.einsum("ca,ca->c", network.contact_torque, network.normal)
        roll = network.contact_torque - twist[:, None] * network.normal
        forces[_N_SLIPS, :n_contacts] = -twist
        forces[_N_SLIPS + 1 :, :n_contacts] = -roll.T
    return forces


def _list_columns(
    geometry: _Geometry, law: Powers | PairLaws, ratios: Array, is_hertz: bool
) -> dict[int, Any]:
    """Return the columns (n_c,) of contacts at rest that compiled loops read, by the places where
    their rows begin.

    ``ratios`` (3 or 7, n_c) are those of :func:`_find_ratios`: slip three times, then twist, and
    roll three times. ``is_hertz`` says whether loops find normal forces by Hertz's law.
    """
    columns: dict[int, Any] = {
        loops.REST + axis * loops.CHUNK: geometry.r[:, axis] for axis in range(3)
    }
    columns |= {
        loops.LENGTH: geometry.length,
        loops.GAP: geometry.gap,
        loops.IS_FREE: geometry.is_free,
        loops.ARM_I: geometry.arm_i,
        loops.ARM_J: geometry.arm_j,
        loops.LEVER_I: geometry.levers[0],
        loops.LEVER_J: geometry.levers[1],
        loops.FORCE: law.rest,
        loops.SLIP_RATIO: ratios[0],
        loops.OPENING: law.end,
    }
    if len(ratios) > _N_SLIPS:
        columns |= {
            loops.TWIST_RATIO: ratios[_N_SLIPS],
            loops.ROLL_RATIO: ratios[_N_SLIPS + 1],
        }
    if is_hertz:
        assert isinstance(law, Powers)
        columns |= {loops.COEFFICIENT: law.coefficient, loops.ROOT: law.root}
    return columns


def _make_columns(ends: tuple[Index, Index], axes: Index, values: dict[int, Any]) -> Columns:
    """Return the contacts, at least one, as loops read them: ``ends`` (n_c,) are the numbers of
    balls i and j, ``axes`` (m,) those of the motions of a ball, and ``values`` the columns (n_c,)
    by the place where their row begins; other columns are zero.

    A column of equal numbers is kept as one number.
    """
    shared = np.zeros(loops.COLUMNS_END // loops.CHUNK)
    separate = {}
    for row, column in values.items():
        shared[row // loops.CHUNK] = column[0]
        if not np.all(column == column[0]):
            separate[row] = column
    n_contacts = len(ends[0])
    return Columns(
        i=ends[0].astype(np.uint32),
        j=ends[1].astype(np.uint32),
        axes=axes,
        shared=shared,
        separate=np.array([*separate.values()], float).reshape(-1, n_contacts),
        lines=np.array([*separate], np.int64),
    )


def _find_geometry(network: ContactNetwork) -> _Geometry:
    """Return the contacts of a ``network`` as contacts that keep their directions at rest: r is the
    normal, and arms are lengths, m.
    """
    zeros = np.zeros(network.n_contacts)
    return _Geometry(
        r=network.normal,
        length=np.ones(network.n_contacts),
        gap=zeros,
        is_free=zeros,
        arm_i=network.arm_i,
        arm_j=network.arm_j,
        levers=np.zeros((2, network.n_contacts)),
    )


def _find_true_geometry(network: ContactNetwork, pairs: MetPairs) -> _Geometry:
    """Return the contacts of a ``network`` and, behind them, the ``pairs`` that may meet, as
    contacts that turn with their balls. Those with flat walls keep their directions.
    """
    i = np.append(network.i, pairs.i)
    j = np.append(network.j, pairs.j)
    is_flat = np.isinf(network.distance)
    vectors = np.where(is_flat[:, None], network.normal, network.vector)
    pair_vectors, gap = _measure_pairs(network, pairs)
    r = np.concatenate([vectors, pair_vectors])
    is_flat = np.append(is_flat, np.isinf(network.radii[pairs.j]))
    # arms share the distance, so that torques balance the moment of forces across contacts
    arm_i = np.append(network.arm_i, network.radii[pairs.i])
    arm_i = np.where(is_flat, arm_i, arm_i / _find_arm_sums(network, pairs))
    levers = np.zeros((2, len(r)))
    if network.lever_excesses is not None:
        radii = network.radii[np.stack([i, j])]
        levers = np.where(np.isfinite(radii), radii, 0.0)
    return _Geometry(
        r=r,
        length=np.sqrt(np.sum(r * r, axis=1)),
        gap=np.append(np.zeros(network.n_contacts), gap),
        is_free=np.where(is_flat, 0.0, 1.0),
        arm_i=arm_i,
        arm_j=np.where(is_flat, 0.0, 1.0 - arm_i),
        levers=levers,
    )


def _measure_pairs(network: ContactNetwork, pairs: MetPairs) -> tuple[Array, Array]:
    """Return, of the ``pairs`` at rest, r (n_p, 3), and the distances (n_p,), m, by which the balls
    have to approach before they push. No pair pushes at rest: a distance below zero counts as zero.
    """
    i = pairs.i
    j = pairs.j
    r = network.positions[j] + pairs.shift @ network.cell - network.positions[i]
    radii_j = np.where(np.isinf(network.radii[j]), 0.0, network.radii[j])
    gap = np.linalg.norm(r, axis=1) - network.radii[i] - radii_j - pairs.bulge
    for wall, (wall_point, wall_normal) in network.walls.items():
        at_wall = j == wall
        balls = i[at_wall]
        r[at_wall] = wall_normal
        to_wall = (wall_point - network.positions[balls]) @ wall_normal
        gap[at_wall] = to_wall - network.radii[balls]
    return r, np.maximum(gap, 0.0)


def _find_arm_sums(network: ContactNetwork, pairs: MetPairs) -> Array:
    """Return the sums of both arms (n_c,), m, of each contact of the ``network`` and, behind, of
    each of the ``pairs``. The arms of a pair are its radii; the arm of a flat wall is zero.
    """
    radii_j = np.where(np.isinf(network.radii[pairs.j]), 0.0, network.radii[pairs.j])
    pair_sums = network.radii[pairs.i] + radii_j
    return np.append(network.arm_i + network.arm_j, pair_sums)


def _find_ratios(network: ContactNetwork, pairs: MetPairs, punch: Array) -> Array:
    """Return the stiffnesses of contacts and of pairs over those of flat punches, ``punch`` (n_c,),
    N/m: (3, n_c), against slip; or (7, n_c), against slip (3), twist and roll (3), m^2. There are 7
    rows if some contact resists twist or roll, or if some contact has a static torque and balls
    rotate.

    The ratio of twist or roll of a pair is in proportion to the square of the distance of its balls
    at touch; the factor is the mean over contacts.
    """
    slip = np.append(network.shear_stiffness / punch, pairs.slip_ratio)
    squares, pair_squares = np.split(_find_arm_sums(network, pairs) ** 2, [network.n_contacts])

    def append_pairs(stiffness: Array) -> Array:
        """Return the ratios of a ``stiffness`` of contacts (n_c,), N m, and of pairs behind."""
        ratio = stiffness / punch
        return np.append(ratio, np.mean(ratio / squares) * pair_squares)

    twist = append_pairs(network.torsion_stiffness)
    roll = append_pairs(network.bending_stiffness)
    has_torque = network.contact_torque is not None and np.any(network.contact_torque)
    is_torque_felt = has_torque and network.ball_motions.rotations
    if is_torque_felt or np.any(twist) or np.any(roll):
        return np.array([slip, slip, slip, twist, roll, roll, roll])
    return np.array([slip, slip, slip])
