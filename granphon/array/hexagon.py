"""A hexagon of balls between six rigid walls: the frame of the experiments, ball by ball.

The balls lie on the triangular lattice, n on each side of the hexagon, and each ball on a side
touches a wall. A wall moves along its normal alone and is pushed with the side force F. Contacts
between balls, and between balls and walls, follow Hertz's law, without friction, and keep the
directions of the lattice: balls and walls are an assembly of contacts that comes to rest as a
crystal does (:mod:`granphon.statics.find_rest`).
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls import hertz
from granphon.balls.hertz import MOST_CONTACT_RADIUS, HertzLaw, contact_radius_ratio
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import balls_on_side, force_of_frame
from granphon.balls.material import Material
from granphon.balls.packing import Packing, given_packing, require_shallow
from granphon.base.arrays import Array, Index
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.validation import finite_array, positive, require, whole_number
from granphon.contacts.assembly import Assembly
from granphon.contacts.laws import ContactLaws
from granphon.dynamics.compatibility import GYRATION
from granphon.networks.network import ContactNetwork
from granphon.statics.configuration import AppliedLoad
from granphon.statics.find_rest import find_rest

#: memory of a ball with its contacts, bytes
_BALL_BYTES = 700.0
#: outward normals of the six walls
_NORMALS = np.array(
    [[math.cos(math.radians(angle)), math.sin(math.radians(angle))] for angle in range(30, 390, 60)]
)


@result_class
class PressedHexagon(Result):
    """A hexagon of balls at rest under the same force on all six walls; SI units.

    Attributes
    ----------
    packing : the packing from which the balls are drawn.
    balls_per_side : n; the hexagon has 3n(n - 1) + 1 balls.
    side_force : F on each wall, N.
    sites : (n_balls, 2) lattice sites, m; the hexagon is centred at the origin.
    deviations : (n_balls,) diameter of each ball less the mean diameter, m.
    displacements : (n_balls, 2) from the sites, m.
    retreats : (6,) displacements of the walls along their outward normals, m, from where they would
        touch balls of the mean diameter on the sites. The normals are at 30, 90, ..., 330 degrees
        from the x axis.
    i, j : (n_c,) numbers of the two balls of each contact between balls.
    normal : (n_c, 2) unit vectors from ball i to ball j.
    ball, wall : (n_w,) numbers of the ball and of the wall of each contact with a wall.
    forces : (n_c,) forces of contacts between balls, N.
    wall_forces : (n_w,) forces of contacts with walls, N.
    wall_coefficient : coefficient of Hertz's law of a ball against a wall, N/m^(3/2).
    residual : largest force left on a ball or a wall, divided by the mean contact force.
    """

    packing: Packing = held(Packing)
    balls_per_side: int = held(int)
    side_force: float = held(float, unit="N", within="above zero")
    sites: Array = held(float, "b 2", "m", "finite")
    deviations: Array = held(float, "b", "m", "finite")
    displacements: Array = held(float, "b 2", "m", "finite")
    retreats: Array = held(float, "6", "m", "finite")
    i: Index = held(int, "c")
    j: Index = held(int, "c")
    normal: Array = held(float, "c 2", within="finite")
    ball: Index = held(int, "w")
    wall: Index = held(int, "w")
    forces: Array = held(float, "c", "N", "finite")
    wall_forces: Array = held(float, "w", "N", "finite")
    wall_coefficient: float = held(float, unit="N/m^(3/2)", within="above zero")
    residual: float = held(float)

    @property
    def positions(self) -> Array:
        """(n_balls, 2) centres, m."""
        return np.asarray(self.sites + self.displacements)

    @property
    def force(self) -> float:
        """Mean force f of the contacts between balls, N, open ones included."""
        return float(np.mean(self.forces))

    @property
    def nominal_force(self) -> float:
        """Contact force F / (n 3^1/2), N, of a hexagon whose side is as long as n balls.

        The mean force in the hexagon itself is exactly F / ((n - 2/3) 3^1/2), as the work of the
        walls shows.
        """
        return float(force_of_frame(self.side_force, self.balls_per_side))

    @property
    def contact_fraction(self) -> float:
        """Fraction of the contacts between balls that carry load."""
        return float(np.mean(self.forces > 0.0))

    @property
    def contact_radius(self) -> float:
        """Ratio of the radius of the largest contact, of two balls or of a ball and a wall, to the
        radius of the mean ball.
        """
        d = self.packing.diameter
        law = self.packing.law
        at_wall = HertzLaw(self.wall_coefficient).overlap(self.wall_forces)
        # a contact with a flat wall is as large as one of two balls with twice the overlap
        overlaps = np.append(law.overlap(self.forces), 2.0 * at_wall)
        return float(contact_radius_ratio(np.max(overlaps), d))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What limits the result, in sentences; empty if nothing does."""
        if self.contact_radius <= MOST_CONTACT_RADIUS:
            return ()
        radius = f"The radius of a contact is {100.0 * self.contact_radius:.4g} % of that of a ball"
        return (
            f"{radius}, more than {100.0 * MOST_CONTACT_RADIUS:g} %: Hertz's law assumes that"
            f" the contact is a small spot.",
        )

    @cached_property
    def network(self) -> ContactNetwork:
        """The balls, the six walls (bodies of infinite mass, which come last), and the contacts
        that carry load.

        The stiffness of a contact with a wall against slip, and that against roll, are the same
        parts of its normal stiffness as between balls, whatever the material of the walls.

        Raises :class:`~granphon.base.errors.InputError` where a network does not hold such
        contacts: with stiffnesses beyond 1e-60 to 1e60 N/m, or overlaps of nearly a diameter.
        """
        packing = self.packing
        d = packing.diameter
        law = packing.law
        count = len(self.sites)
        is_loaded = self.forces > 0.0
        is_wall_loaded = self.wall_forces > 0.0
        wall = self.wall[is_wall_loaded]
        normal = np.zeros((int(np.sum(is_loaded)) + len(wall), 3))
        normal[:, :2] = np.concatenate([self.normal[is_loaded], _NORMALS[wall]])
        ball_forces = self.forces[is_loaded]
        wall_forces = self.wall_forces[is_wall_loaded]
        ball_stiffness = hertz.stiffness_under(law.coefficient**2 * ball_forces)
        wall_stiffness = hertz.stiffness_under(self.wall_coefficient**2 * wall_forces)
        stiffness = np.concatenate([ball_stiffness, wall_stiffness])
        masses = np.append(np.full(count, packing.mass), np.full(6, math.inf))
        arm_i = np.full(len(normal), 0.5 * d)
        arm_j = np.append(arm_i[: len(ball_forces)], np.zeros(len(wall)))  # walls do not turn
        return ContactNetwork(
            cell=np.zeros((3, 3)),
            pbc=(False, False, False),
            positions=self._find_centres(),
            radii=np.append(0.5 * (d + self.deviations), np.full(6, math.inf)),
            masses=masses,
            inertias=masses * (GYRATION * d) ** 2,
            i=np.append(self.i[is_loaded], self.ball[is_wall_loaded]),
            j=np.append(self.j[is_loaded], count + wall),
            shift=np.zeros((len(normal), 3), int),
            normal=normal,
            normal_force=np.append(ball_forces, wall_forces),
            normal_stiffness=stiffness,
            shear_stiffness=packing.mindlin_ratio * stiffness,
            torsion_stiffness=np.zeros(len(normal)),  # balls turn about z alone: nothing twists
            bending_stiffness=packing.bending * d * d * stiffness,
            arm_i=arm_i,
            arm_j=arm_j,
            motions="in_plane",
            dimension=2,
        )

    def _find_centres(self) -> Array:
        """Return the centres (n_balls + 6, 3) of the balls, m, and then the point of each wall that
        is nearest to the centre of the hexagon.
        """
        # distances of the walls from the centre: that of the outermost row, half of a diameter, and
        # the retreat of the wall
        at_touch = self.packing.diameter * (_find_outermost_row(self.balls_per_side) + 0.5)
        distances = at_touch + self.retreats
        centres = np.zeros((len(self.sites) + 6, 3))
        centres[:-6, :2] = self.positions
        centres[-6:, :2] = distances[:, None] * _NORMALS
        return centres


class Hexagon:
    """A hexagon of balls drawn from a packing, between six walls.

    Parameters
    ----------
    packing : of the triangular lattice, with motions in the plane.
    balls_per_side : n, at least 2.
    seed : random seed of the diameters; not read if ``diameters`` are given.
    diameters : (3n(n - 1) + 1,) diameters, m, in place of random ones, in the order of
        :attr:`sites`.
    wall_material : material of the walls; None for rigid walls.

    Raises
    ------
    InputError : no packing, or no material of the walls; another lattice or other motions; a number
        out of range; more balls than memory holds; diameters of another shape, or whose mean is not
        the packing's diameter.
    """

    def __init__(
        self,
        packing: Packing,
        balls_per_side: int = 31,
        seed: int = 0,
        *,
        diameters: ArrayLike | None = None,
        wall_material: Material | None = None,
    ) -> None:
        _require_triangular(packing)
        if not isinstance(wall_material, Material | None):
            raise InputError(
                f"wall_material is {brief(wall_material)}", mend="Give a gp.Material, or None"
            )
        self.packing = packing
        n = int(require("balls_per_side", balls_on_side, balls_per_side))
        if n < 2:
            raise InputError(
                "a hexagon of one ball has no contacts between balls",
                mend="Give balls_per_side of 2 or more",
            )
        self.balls_per_side = n
        self.seed = None if diameters is not None else whole_number("seed", seed, 0)
        n_balls = 3 * n * (n - 1) + 1
        require_memory(
            f"hexagons of {n_balls:,} balls", _BALL_BYTES * n_balls, "Give fewer balls_per_side"
        )
        # a rhombus of cells (p, q) without those at its two acute corners is a hexagon
        steps = np.arange(1 - n, n)
        cells = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        self._cells = cells[np.abs(cells[:, 0] - cells[:, 1]) < n]
        #: (3n(n - 1) + 1, 2) lattice sites, m
        self.sites: Array = read_only(packing.diameter * self._cells @ TRIANGULAR.vectors)
        #: (3n(n - 1) + 1,) deviations from the mean diameter, m
        self.deviations = read_only(_find_deviations(packing, n_balls, diameters, self.seed))
        #: coefficient of Hertz's law of a ball against a wall, N/m^(3/2)
        self.wall_coefficient = _find_wall_coefficient(packing, wall_material)

    # -- contacts ----------------------------------------------------------------------------------

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        """Numbers (n_c,) of the balls i, and (n_c,) of the balls j, of the contacts between balls,
        and normals (n_c, 2) from ball i to ball j.
        """
        # the number of the ball in each cell (p, q) of the lattice
        number = {cell: ball for ball, cell in enumerate(map(tuple, self._cells.tolist()))}
        table = TRIANGULAR.contacts
        contacts = [
            (ball, number[p + a, q + b], kind)
            for (p, q), ball in number.items()
            for kind, (a, b) in enumerate(table.shift.tolist())
            if (p + a, q + b) in number
        ]
        i, j, kinds = np.array(contacts).T
        return i, j, table.normal[kinds]

    @cached_property
    def _wall_contacts(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Numbers (n_w,) of the balls, and (n_w,) of the walls, of the contacts with walls."""
        distances = self.sites @ _NORMALS.T / self.packing.diameter
        # a tenth of a diameter is far above rounding, and far below the distance to the next row
        ball, wall = np.nonzero(distances > _find_outermost_row(self.balls_per_side) - 0.1)
        return ball, wall

    @property
    def _middle(self) -> int:
        """Number of the ball in the middle of the hexagon."""
        return int(np.argmin(np.sum(self.sites**2, axis=1)))

    @cached_property
    def _assembly(self) -> Assembly:
        """The balls and the walls, with the contacts between balls first.

        As all walls move, nothing holds the whole against translations. The ball in the middle is
        therefore held: it is not among the balls of the assembly.
        """
        i, j, normal = self._pairs
        ball, wall = self._wall_contacts
        count = len(self.sites) - 1
        # numbers of bodies: moving balls, then the six walls, then what is held
        body = np.insert(np.arange(count), self._middle, count + 6)
        radii = 0.5 * self.deviations
        n_pairs = len(i)
        n_contacts = n_pairs + len(ball)
        d = self.packing.diameter
        vector = np.zeros((n_contacts, 3))
        vector[:n_pairs, :2] = d * normal
        vector[n_pairs:, :2] = 0.5 * d * _NORMALS[wall]
        contacts = np.arange(n_contacts)
        between_balls = (self.packing.law, contacts[:n_pairs])
        at_walls = (HertzLaw(self.wall_coefficient), contacts[n_pairs:])
        return Assembly(
            n_balls=count,
            i=np.append(body[i], body[ball]).astype(np.int64),
            j=np.append(body[j], count + wall).astype(np.int64),
            vector=vector,
            is_flat=contacts >= n_pairs,
            offset=np.append(radii[i] + radii[j], radii[ball]),
            laws=ContactLaws([between_balls, at_walls], n_contacts),
            cell=np.zeros((0, 0)),
            dimension=2,
            directions=_NORMALS,
            wall_balls=np.full(6, float(self.balls_per_side)),
        )

    # -- at rest -----------------------------------------------------------------------------------

    def at_side_force(self, side_force: float) -> PressedHexagon:
        """Press each wall with the ``side_force`` F, N, and return the balls at rest.

        Raises :class:`~granphon.base.errors.InputError` for a force that is not above zero, or that
        presses balls together by their diameter or into a wall by their radius, and
        :class:`~granphon.base.errors.ConvergenceError` if the balls do not come to rest. What
        limits the result otherwise is in its ``warnings``.
        """
        force = positive("side_force", side_force, "N")
        self._require_shallow(force, force_of_frame(force, self.balls_per_side), 0.0)
        assembly = self._assembly
        load = self._push_walls(force)
        try:
            rest = find_rest(assembly, load)
        except ConvergenceError as error:
            raise ConvergenceError(
                f"the hexagon has not come to rest under {load.words}",
                "Balls that differ far more than they overlap hardly hold each other",
                "Raise the side force, or take fewer balls",
            ) from error
        forces = assembly.laws.force(rest.overlap)
        i, j, normal = self._pairs
        ball, wall = self._wall_contacts
        between_balls = forces[: len(i)]
        at_walls = forces[len(i) :]
        self._require_shallow(force, float(np.max(between_balls)), float(np.max(at_walls)))
        return PressedHexagon(
            packing=self.packing,
            balls_per_side=self.balls_per_side,
            side_force=force,
            sites=self.sites,
            deviations=self.deviations,
            displacements=np.insert(rest.displacement, self._middle, 0.0, axis=0),
            retreats=rest.wall_motion,
            i=i,
            j=j,
            normal=normal,
            ball=ball,
            wall=wall,
            forces=between_balls,
            wall_forces=at_walls,
            wall_coefficient=self.wall_coefficient,
            residual=rest.residual,
        )

    def _push_walls(self, side_force: float) -> AppliedLoad:
        """Return the load of a ``side_force``, N, that pushes each wall inwards."""
        on_balls = np.zeros(2 * self._assembly.n_balls)
        return AppliedLoad(
            force=np.append(on_balls, np.full(6, -side_force)),
            words=f"side_force = {side_force:g} N",
            stress=None,
            strain=np.zeros((0, 0)),
            pressure_force=np.append(on_balls, np.zeros(6)),
        )

    def _require_shallow(self, side_force: float, between: float, at_wall: float) -> None:
        """Raise :class:`InputError` if the force ``between``, N, presses two balls together by
        their diameter, or if the force ``at_wall``, N, presses a ball into its wall by the radius
        of the ball. The message states the ``side_force``, N.
        """
        packing = self.packing
        load = f"side_force = {side_force:g} N"
        require_shallow(
            packing.material.young_modulus,
            float(packing.law.overlap(between)) / packing.diameter,
            lambda: load,
        )
        depth = 2.0 * float(HertzLaw(self.wall_coefficient).overlap(at_wall)) / packing.diameter
        if not depth < 1.0:
            problem = f"{load} presses a ball into its wall by {depth:.4g} times its radius"
            raise InputError(problem, "Its centre would be beyond the wall", "Lower the load")

    def at_force(self, force: float) -> PressedHexagon:
        """Press each wall with F = n 3^1/2 f, where f is the contact ``force``, N, and return the
        balls at rest; see :meth:`at_side_force`, also for what is raised.

        f is the :attr:`~PressedHexagon.nominal_force`; the mean force of the contacts is larger by
        the factor n/(n - 2/3).
        """
        return self.at_side_force(
            positive("force", force, "N") * math.sqrt(3.0) * self.balls_per_side
        )


def _require_triangular(packing: Packing) -> None:
    """Raise InputError if ``packing`` is no Packing, or unless its lattice is the triangular one
    and its balls move in the plane.
    """
    structure = given_packing(packing).structure
    # a lattice of one ball in the cell with three contacts in the plane is triangular; honeycombs
    # have three contacts in a cell of two balls
    is_triangular = structure.n_balls == 1 and structure.contacts.normal.shape == (3, 2)
    if not is_triangular or packing.named_motions.name != "in_plane":
        raise InputError(
            f"a hexagon of the {packing.structure.name} lattice with motions"
            f" {packing.named_motions.name}",
            "The hexagon is made of the triangular lattice, in its plane",
            "Leave lattice and motions out of the Packing",
        )


def _find_wall_coefficient(packing: Packing, wall_material: Material | None) -> float:
    """Return the coefficient of Hertz's law, N/m^(3/2), of a ball of the ``packing`` against a flat
    wall; without a ``wall_material`` the wall is rigid.

    It is that of two balls times sqrt(2), as the reduced radius is twice as large, and times 2/(1 +
    E_b/E_w), with the contact moduli E_b of the balls and E_w of the wall.
    """
    modulus_ratio = 0.0
    if wall_material is not None:
        modulus_ratio = packing.material.contact_modulus / wall_material.contact_modulus
    return packing.law.coefficient * math.sqrt(2.0) * 2.0 / (1.0 + modulus_ratio)


def _find_outermost_row(balls_per_side: int) -> float:
    """Return the distance, in diameters, from the centre to the row of balls along a wall; rows are
    (3/4)^(1/2) apart.
    """
    return (balls_per_side - 1) * math.sqrt(0.75)


def _find_deviations(
    packing: Packing, count: int, diameters: ArrayLike | None, seed: int | None
) -> Array:
    """Return deviations (count,) from the mean diameter, m; their mean is zero. They are those of
    the ``diameters``, m, if these are given, and otherwise those of ``count`` balls of the packing
    that are drawn with the ``seed``.

    Raises InputError if the diameters are not finite and above zero, or have another shape, or
    another mean than the packing.
    """
    if diameters is None:
        if packing.spread is None:
            return np.zeros(count)
        assert seed is not None  # only beside diameters there is none
        deviations = packing.spread.sample(count, seed)
        return np.asarray(deviations - np.mean(deviations))
    values = finite_array("diameters", diameters, "m", "above zero")
    if values.shape != (count,):
        raise InputError(f"diameters have the shape {values.shape}", mend=f"Give {count} numbers")
    d = packing.diameter
    mean = float(np.mean(values))
    if abs(mean - d) > 1e-9 * d:
        raise InputError(
            f"the mean of the diameters is {mean:.9g} m, that of the packing {d:.9g} m",
            mend="Shift the diameters, or make a Packing of this mean diameter",
        )
    return np.asarray(values - np.mean(values))
