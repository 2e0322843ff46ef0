"""The compatibility matrix: the deformations of all contacts of a lattice from the motions of all
its balls.

Every quantity of the lattice follows from this matrix, C. Its rows are those of
:mod:`granphon.dynamics.deformation_rows`. With the stiffnesses K and the masses M the dynamical
matrix is D(q) = M^-1/2 C(q)^H K C(q) M^-1/2. All numbers are in reduced units: length d, stiffness
k, mass M. The rotation phi of a ball is represented by the length w = R_g phi, R_g = (I/M)^1/2,
whose inertia is the mass of the ball.
"""

from __future__ import annotations

from dataclasses import fields as list_fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.motions import IN_PLANE, Motions, select_motions
from granphon.balls.neighbours import ContactTable
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, InstabilityError, PrecisionError, brief
from granphon.base.results import read_only
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    Low,
    finite_array,
    not_negative,
    real_array,
    require_instance,
)
from granphon.dynamics.deformation_rows import (
    ANCHOR,
    Row,
    WaveRows,
    anchor_rows,
    carry_rows,
    contact_rows,
    excess_pairs,
    excess_rows,
    growth_rows,
    push_rows,
    split_pairs,
    torque_pairs,
    weigh_rows,
)
from granphon.networks.network import ContactNetwork

#: radius of gyration of a ball about a diameter, (I/M)^1/2 = d/sqrt(10) (equation 8)
GYRATION = float(1.0 / np.sqrt(10.0))
#: components of a wave vector in reciprocal vectors above which no digit is left for its place
#: between two of them
_LARGEST_COMPONENT = 1e15
#: most memory that the modes at one wave vector may take, bytes
MOST_BYTES = 2**33
#: part of the largest squared frequency by which the lack of a potential of static tangential
#: forces may lower other squares. A tenth of this was seen where overlaps are d/50
_POTENTIAL_SLACK = 1e-5
#: distance, over the size of the cell, up to which two centres are one point
_CENTRE_TOLERANCE = 1e-9
#: distance of a wave vector from a copy of Gamma, over that of the copy from Gamma, up to which the
#: distance is rounding
_COPY_ROUNDING = 1e-15
#: relative difference up to which two numbers are equal but for rounding
_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
#: the same of what balls at rest give, stiffnesses, forces and arms: rounding adds up over the
#: steps of a search for rest
_REST_ROUNDING = 1e-13


def put_in_space(vectors: Array) -> Array:
    """Return ``vectors`` (n, d) with zeros for the other components of three, (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def as_wavevectors(wavevectors: ArrayLike, periods: int) -> Array:
    """Return ``wavevectors`` (..., p) as an array (n_q, p).

    Raises :class:`~granphon.base.errors.InputError` if they are no real numbers, if p is not the
    number of ``periods``, or if a number is not finite.
    """
    q = real_array("wavevectors", wavevectors)
    if q.shape[-1:] != (periods,):
        raise InputError(
            f"the wave vectors have the shape {q.shape}", mend=f"Give an array (n_q, {periods})"
        )
    _require_finite(q)
    return q.reshape(-1, periods)


def _require_finite(components: Array) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if a component of a wave vector is not
    finite; ``components`` are an array of any shape.
    """
    if not np.all(np.isfinite(components)):
        raise InputError("a wave vector is not finite", mend="Give finite numbers")


def require_digits(components: Array) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if wave vectors are too far from Gamma.

    ``components``, an array of any shape, are their components in reciprocal vectors.
    """
    # nan is the difference of two components that overflow
    sizes = np.nan_to_num(np.abs(components), nan=np.inf, posinf=np.inf)
    farthest = float(np.max(sizes, initial=0.0))
    if farthest > _LARGEST_COMPONENT:
        raise PrecisionError(
            f"a wave vector is {farthest:.3g} reciprocal vectors from Gamma",
            f"Beyond {_LARGEST_COMPONENT:.0e} no digit is left for its place between two reciprocal"
            " vectors",
            "Leave whole reciprocal vectors out",
        )


def _repeat(name: str, values: ArrayLike, shape: tuple[int, ...], low: Low | None = "") -> Array:
    """Return ``values`` repeated to a ``shape``, read-only.

    Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name``, for values that
    cannot have this shape, and for a number that is not finite, or not in the range that ``low``
    names; numbers are not checked if ``low`` is None.
    """
    numbers = real_array(name, values)
    if numbers.size and low is not None:  # a lattice may have no balls or no contacts
        numbers = finite_array(name, numbers, low=low)
    try:
        return read_only(np.broadcast_to(numbers, shape))
    except ValueError:
        problem = f"{name} has the shape {numbers.shape}"
        raise InputError(problem, mend=f"Give a number, or an array {shape}") from None


def _read_vectors(name: str, vectors: ArrayLike) -> Array:
    """Return ``vectors`` as an array (n, d).

    Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name``, for another
    number of axes, and for a number that is not finite.
    """
    numbers = real_array(name, vectors)
    if numbers.ndim != 2:
        raise InputError(
            f"{name} has the shape {numbers.shape}", mend="Give one vector in each row"
        )
    return finite_array(name, numbers) if numbers.size else numbers  # of no ball, or no period


def _read_springs(on_site: ArrayLike | None, motions: Motions, n_contacts: int) -> Array | None:
    """Return the stiffnesses ``on_site`` of springs to the ground as a read-only array (n_g,
    motions); None without springs.

    Raises :class:`~granphon.base.errors.InputError` for another shape, for more springs than
    ``n_contacts``, and for a stiffness below zero or not finite.
    """
    if on_site is None:
        return None
    springs = finite_array("on_site", on_site, low="zero or above")
    if springs.ndim != 2 or springs.shape[1] != motions.count or len(springs) > n_contacts:
        raise InputError(
            f"on_site has the shape {springs.shape}",
            f"There are {n_contacts} contacts, of which the last are the springs",
            f"Give an array (n, {motions.count}), with a stiffness for each motion",
        )
    return read_only(springs)


class Compatibility:
    """Balls in contact on a periodic lattice, in reduced units, with their compatibility matrix
    C(q) and their dynamical matrix D(q).

    Parameters
    ----------
    cell : (p, d) lattice vectors as rows: p periods in d dimensions. One period lies along x, two
        lie in the xy plane.
    positions : (n, d) centres.
    contacts : the table of contacts, in the same unit of length. The number j = n stands for all
        bodies that do not move; the vector of a contact with one is zero, and C has no columns for
        that end.
    mindlin_ratio : eta, stiffness of slip over that of elongation; a number, or (n_c,).
    stiffness : (n_c,) normal stiffness of each contact; 1 by default.
    prestress : (n_c,) compressive force over the distance of the centres, f/a, of each contact; 0
        by default, which is the limit of Velicky and Caroli (2002).
    masses : (n,) masses; 1 by default.
    gyration : (n,) radii of gyration; d/sqrt(10) by default.
    torsion : stiffness of twist over d^2 times that of elongation; a number, or (n_c,).
    bending : stiffness of rolling over d^2 times that of elongation; a number, or (n_c,).
    tangential_force : (n_c, d) static forces across contacts, with which ball i acts on ball j;
        none by default. The forces act on motions as in
        :func:`~granphon.dynamics.deformation_rows.carry_rows`, without the part that has no
        potential.
    contact_torque : (n_c, 3) static torques of rolling and twist, with which ball i acts on ball j;
        none by default. The torques act on motions in space as in
        :func:`~granphon.dynamics.deformation_rows.torque_pairs`, without the part that has no
        potential; in a plane they do not change.
    tangential_growth : (n_c,) derivative of a tangential force with respect to the overlap, over
        the force, 1/d; 0 by default.
    lever_excesses : (2, n_c) differences, in d, of the levers of slip from the arms, at balls i and
        at balls j; 0 by default. The differences act on motions as in
        :func:`~granphon.dynamics.deformation_rows.excess_pairs`, without the part that has no
        potential.
    slip_stretch : (n_c,) by how much slip exceeds the displacement across a contact that makes it,
        over that displacement; 0 by default. The stretch acts together with ``lever_excesses``.
    arm_rates : (n_c,) by how much the arms of a contact grow with its elongation, where tangential
        forces act; 1/2 by default.
    turns_with_balls : whether tangential forces turn about the normals with the balls; they do not
        by default.
    distance : (n_c,) distance r of the two centres, infinite from a flat wall; a tangential force
        turns with the line between the centres. By default r is the length of the vector of the
        contact. So ``distance`` must be given if tangential forces act and balls touch bodies that
        do not move.
    motions : motions of each ball; those of the plane by default. Rotations that no contact and no
        spring to the ground resists are left out.
    on_site : (n_g, motions) stiffness, k, of springs to the ground against u and w of the balls;
        none by default. The last n_g of the contacts are these springs, of ball i with the ground;
        such a contact resists nothing else.
    name : name of the lattice in messages.

    Raises
    ------
    InputError : no period; vectors of the cell that are dependent, or not
        along x or in the xy plane; a wrong shape; what is no real number; a number other than
        ``distance`` that is not finite; a mass, a radius of gyration or a stiffness that is not
        above zero; a ratio of stiffnesses or a spring to the ground below zero; more springs than
        contacts; contacts that are no table, or those of other balls, periods or dimensions; and
        motions that are none.
    """

    def __init__(
        self,
        cell: ArrayLike,
        positions: ArrayLike,
        contacts: ContactTable,
        mindlin_ratio: ArrayLike,
        stiffness: ArrayLike = 1.0,
        prestress: ArrayLike = 0.0,
        masses: ArrayLike = 1.0,
        gyration: ArrayLike = GYRATION,
        *,
        torsion: ArrayLike = 0.0,
        bending: ArrayLike = 0.0,
        tangential_force: ArrayLike = 0.0,
        contact_torque: ArrayLike = 0.0,
        tangential_growth: ArrayLike = 0.0,
        lever_excesses: ArrayLike = 0.0,
        slip_stretch: ArrayLike = 0.0,
        arm_rates: ArrayLike = 0.5,
        turns_with_balls: bool = False,
        distance: ArrayLike | None = None,
        motions: Motions = IN_PLANE,
        on_site: ArrayLike | None = None,
        name: str = "of these contacts",
    ) -> None:
        """Keep the arguments: the ``contacts`` as they are, other arrays as read-only copies, and
        numbers repeated for each contact or ball, but for ratios, which stay numbers.
        """
        require_instance("contacts", contacts, ContactTable, "Give a ContactTable")
        require_instance("motions", motions, Motions, "Give gp.Motions")
        self.name = name
        self.on_site = _read_springs(on_site, motions, len(contacts))
        self.cell: Array = read_only(_read_vectors("cell", cell))
        self.positions: Array = read_only(_read_vectors("positions", positions))
        p, d = self.cell.shape
        if not 0 < p <= d == self.positions.shape[1]:
            raise InputError(
                f"cell has the shape {self.cell.shape}, and positions {self.positions.shape}",
                "A cell (p, d) has p vectors of as many components d as the positions, 1 <= p <= d",
            )
        if np.any(self.cell[:, p:]) or np.linalg.matrix_rank(self.cell) < p:
            raise InputError(
                f"cell is {brief(self.cell)}",
                "Its vectors are independent: one lies along x, two lie in the xy plane",
            )
        self.contacts = contacts
        self._require_table()
        self.mindlin_ratio = self._read_ratio("mindlin_ratio", mindlin_ratio)
        self.torsion = self._read_ratio("torsion", torsion)
        self.bending = self._read_ratio("bending", bending)
        self.named_motions = motions
        self.motions = select_motions(
            self.mindlin_ratio, self.torsion, self.bending, motions, self.on_site
        )
        of_contacts = (len(contacts),)
        self.stiffness = _repeat("stiffness", stiffness, of_contacts, "above zero")
        self.prestress = _repeat("prestress", prestress, of_contacts)
        self.tangential_force = _repeat("tangential_force", tangential_force, contacts.normal.shape)
        self.contact_torque = _repeat("contact_torque", contact_torque, (len(contacts), 3))
        self.tangential_growth = _repeat("tangential_growth", tangential_growth, of_contacts)
        self.lever_excesses = _repeat("lever_excesses", lever_excesses, (2, len(contacts)))
        self.slip_stretch = _repeat("slip_stretch", slip_stretch, of_contacts)
        self.arm_rates = _repeat("arm_rates", arm_rates, of_contacts)
        self.turns_with_balls = turns_with_balls
        if distance is None:
            distance = np.linalg.norm(contacts.vector, axis=1)
        self.distance = _repeat("distance", distance, of_contacts, None)
        self.masses = _repeat("masses", masses, (self.n_balls,), "above zero")
        self.gyration = _repeat("gyration", gyration, (self.n_balls,), "above zero")

    def _require_table(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the contacts join balls of this
        lattice, or one with a body that does not move, and their columns have as many components
        as its periods and dimensions.
        """
        table = self.contacts
        p, d = self.cell.shape
        shapes = (table.shift.shape[1:], table.normal.shape[1:], table.vector.shape[1:])
        if shapes != ((p,), (d,), (d,)):
            raise InputError(
                f"the contacts have shifts, normals and vectors of the shapes {shapes}",
                f"The lattice has {counted(p, 'period')} and {counted(d, 'dimension')}",
            )
        n = self.n_balls
        if np.any((table.i < 0) | (table.i >= n) | (table.j < 0) | (table.j > n)):
            raise InputError(
                "a contact joins balls that the lattice does not have",
                f"It has {counted(n, 'ball')}",
                f"Number balls i from 0 to {n - 1}, and balls j to {n}, a body that does not move",
            )

    def _read_ratio(self, name: str, ratio: Any) -> float | Array:
        """Return a ``ratio`` of stiffnesses as a float, or as an array (n_c,) if it is an array or
        a list.

        Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name``, for another
        shape, and if a ratio is below zero or not finite.
        """
        is_array = isinstance(ratio, np.ndarray) and ratio.ndim > 0
        if not is_array and not isinstance(ratio, list | tuple):
            return not_negative(name, ratio)
        return _repeat(name, ratio, (len(self.contacts),), "zero or above")

    # -- sizes -------------------------------------------------------------------------------------

    @cached_property
    def n_balls(self) -> int:
        """Number of balls in the cell."""
        return len(self.positions)

    @cached_property
    def n_branches(self) -> int:
        """Number of branches: the degrees of freedom in the cell."""
        return self.motions.count * self.n_balls

    @property
    def dimension(self) -> int:
        """Number d of components of the positions of the balls."""
        return int(self.positions.shape[1])

    @cached_property
    def periods(self) -> int:
        """Number p of lattice vectors."""
        return len(self.cell)

    @cached_property
    def bytes_per_wavevector(self) -> int:
        """Estimated peak of the memory, bytes, while the modes at one wave vector are found."""
        n_contacts = len(self.contacts)
        n = self.n_branches
        # complex numbers of six arrays like C(q), and of ten like D(q)
        return 16 * n * (6 * len(self.rows) * n_contacts + 10 * n)

    def _require_memory(self, size: float) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the memory that one wave vector takes,
        ``size`` in bytes, is more than :data:`MOST_BYTES`.
        """
        if size > MOST_BYTES:
            raise InputError(
                f"the cell of {counted(self.n_balls, 'ball')} has {self.n_branches} branches",
                f"One wave vector takes {size / 2**30:.2g} GiB of memory, more than"
                f" {MOST_BYTES >> 30}",
                "Take a smaller cell, or gp.Waves(network), whose matrices are sparse",
            )

    def _require_contacts(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the lattice has no contacts."""
        if not len(self.contacts):
            raise InputError(
                "the lattice has no contacts",
                "Balls that touch nothing neither vibrate nor carry sound",
                "Bring balls into contact",
            )

    @cached_property
    def is_held(self) -> bool:
        """Whether balls touch bodies that do not move, or springs to the ground resist their
        displacements. Then no displacement of all balls counts as free, and sound is not found,
        also where such bodies or springs resist some of the displacements alone.
        """
        touches_body = np.any(self.contacts.j[: self.n_between] == self.n_balls)
        return bool(touches_body) or self.is_anchored

    @property
    def is_anchored(self) -> bool:
        """Whether springs to the ground resist displacements."""
        springs = self.on_site
        return springs is not None and bool(np.any(springs[:, self.named_motions.translating]))

    @property
    def has_springs(self) -> bool:
        """Whether springs to the ground resist a displacement or a rotation of a ball."""
        return self.on_site is not None and bool(np.any(self.on_site))

    @cached_property
    def n_between(self) -> int:
        """Number of contacts without the springs to the ground, which come last."""
        return len(self.contacts) - (0 if self.on_site is None else len(self.on_site))

    @cached_property
    def measure(self) -> float:
        """Length, area or volume of the cell, in units of d to the power p."""
        return float(abs(np.linalg.det(self.cell[:, : self.periods])))

    @cached_property
    def reciprocal(self) -> Array:
        """(p, p) reciprocal vectors as rows, 1/d, with the factor 2 pi."""
        return read_only(2.0 * np.pi * np.linalg.inv(self.cell[:, : self.periods]).T)

    @cached_property
    def is_prestressed(self) -> bool:
        """Whether static contact forces, or levers of slip that exceed the arms, enter the
        stiffness, so that D may have negative eigenvalues.
        """
        return bool(np.any(self.prestress != 0.0) or self.lacks_potential)

    @property
    def slack(self) -> float:
        """Part of the largest squared frequency by which eigenvalues of D may be negative although
        the balls are at rest.

        D lacks the part of static tangential forces and torques, and of slip by levers that exceed
        the arms, that has no potential. Without this part motions that cost nothing, such as the
        spin of a ball about its two contacts, have negative eigenvalues of second order in the
        forces and in the excess.
        """
        return _POTENTIAL_SLACK if self.lacks_potential else 0.0

    @cached_property
    def lacks_potential(self) -> bool:
        """Whether tangential forces, torques or slip by levers that exceed the arms act at
        contacts: D lacks the part of these that has no potential.
        """
        return self.has_tangential_force or self.has_torque or self.has_excesses

    @cached_property
    def has_excesses(self) -> bool:
        """Whether some lever of slip differs from its arm."""
        return bool(np.any(self.lever_excesses != 0.0))

    @cached_property
    def has_torque(self) -> bool:
        """Whether static torques of rolling and twist act on motions: in space alone."""
        is_in_space = self.contacts.normal.shape[1] == 3
        return is_in_space and bool(np.any(self.contact_torque != 0.0))

    @cached_property
    def has_tangential_force(self) -> bool:
        """Whether static forces act across contacts."""
        return bool(np.any(self.tangential_force != 0.0))

    def wavevectors(self, fractions: ArrayLike) -> Array:
        """Return the Cartesian wave vectors (..., p), 1/d, of ``fractions`` (..., p) or (..., 3) of
        the reciprocal vectors.

        Raises :class:`~granphon.base.errors.InputError` for what is no array of real numbers, for
        another shape, for numbers that are not finite, and for a component other than zero along an
        axis without period; and
        :class:`~granphon.base.errors.PrecisionError` for a wave vector too far from Gamma.
        """
        components = real_array("fractions", fractions)
        p = self.periods
        if components.shape[-1:] not in ((p,), (3,)):
            shapes = "(..., 3)" if p == 3 else f"(..., {p}) or (..., 3)"
            raise InputError(
                f"the fractions have the shape {components.shape}", mend=f"Give an array {shapes}"
            )
        _require_finite(components)
        if np.any(components[..., p:]):
            raise InputError(
                "a wave vector has a component across the lattice",
                f"The lattice has {counted(p, 'period')}",
                "Give 0 for the rest",
            )
        require_digits(components)
        return np.asarray(components[..., :p] @ self.reciprocal)

    def _fold(self, wavevectors: ArrayLike) -> tuple[Array, Array]:
        """Return equivalent wave vectors (n_q, p) near Gamma, 1/d, and the sums (n_q, p) of
        reciprocal vectors that were subtracted from ``wavevectors`` (..., p).

        Without this step, half angles at a copy of Gamma would be multiples of pi, whose sines are
        rounding errors. Raises what :func:`as_wavevectors` raises, and
        :class:`~granphon.base.errors.PrecisionError` for a wave vector too far from Gamma.
        """
        q = as_wavevectors(wavevectors, self.periods)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused below
            fractions = q @ self.cell[:, : self.periods].T / (2.0 * np.pi)
        require_digits(fractions)
        copies = np.rint(fractions) @ self.reciprocal
        near_q = q - copies
        # at a copy of Gamma only the rounding of the reciprocal vector is left: set it to zero
        is_rounding = np.linalg.norm(near_q, axis=1) <= _COPY_ROUNDING * np.linalg.norm(
            copies, axis=1
        )
        is_copy = np.any(copies != 0.0, axis=1)
        near_q[is_rounding & is_copy] = 0.0
        return near_q, copies

    def name_wavevector(self, wavevector: Array) -> str:
        """Return the text of a ``wavevector`` (p,), 1/d, in fractions of the reciprocal vectors."""
        fractions = wavevector @ self.cell[:, : self.periods].T / (2.0 * np.pi)
        fractions = np.round(fractions, 12) + 0.0  # no minus zero
        return f"q = ({', '.join(f'{fraction:.6g}' for fraction in fractions)})"

    def explain_buckling(self, where: str, motion: ArrayLike) -> InstabilityError:
        """Return the error that says that static forces make the lattice buckle.

        ``where`` are words for the wave vector or direction at which it does, and ``motion``
        (n_u, ...) are the displacements by which it does, in the order of the translations; an
        empty list if they are not known. A flat lattice that buckles perpendicular to its periods
        does so at any load; the error says so.
        """
        displacements = np.reshape(motion, (len(self.motions.translations), -1))
        energy = np.sum(np.abs(displacements) ** 2, axis=1)
        is_across = np.array(self.motions.translations) >= self.periods
        why = "The contact forces push the balls sideways more than the contacts hold them"
        leave_out = "leave static forces out (without finite_overlap, or with prestress=False)"
        mend = f"Lower the load, or {leave_out}"
        is_flat = not np.any(self.contacts.normal[:, self.periods :])
        moves_across = energy[is_across].sum() > energy[~is_across].sum()
        if is_flat and moves_across:
            if self.periods == 1:
                arrangement = "straight chain"
                line_or_plane = "line"
                motions = "longitudinal"
            else:
                arrangement = "flat layer"
                line_or_plane = "plane"
                motions = "in_plane"
            why = (
                f"Under pressure a {arrangement} of balls does so at any load: each contact pushes"
                f" balls that leave the {line_or_plane} farther out, with the stiffness -f/a, and"
                " nothing else acts on long waves"
            )
            mend = f"Use the motions {motions}, or {leave_out}"
        return InstabilityError(f"the lattice {self.name} buckles: {where}", why, mend)

    # -- the compatibility matrix ------------------------------------------------------------------

    @cached_property
    def _frame(self) -> Array:
        """(n, n) orthogonal matrix whose first column is the motion of the centre of mass in
        mass-weighted coordinates.

        In this frame the motion of a long wave has one column in C, made of sines of half angles;
        it would otherwise be a difference between n columns, and lose digits.
        """
        self._require_memory(self.bytes_per_wavevector)
        return self._complete(np.sqrt(self.masses / self.masses.sum()))

    @staticmethod
    def _complete(first_column: Array) -> Array:
        """Return an orthogonal matrix (n, n) with the ``first_column`` (n,), a vector of length one
        whose first entry is not zero.
        """
        basis = np.eye(len(first_column))
        basis[:, 0] = first_column
        frame, _ = np.linalg.qr(basis)
        # column k > 0 is zero for the balls 1 to k - 1. Rounding errors there would couple the
        # column to the contacts of these balls
        frame[1:, 1:] = np.tril(frame[1:, 1:])
        # QR leaves the sign of the first column open
        return np.asarray(frame * np.sign(frame[0, 0] * first_column[0]))

    def compatibility(self, wavevectors: ArrayLike, derivative: bool = False) -> NDArray[Any]:
        """Return K^1/2 C(q) M^-1/2, (k/M)^1/2, at each wave vector, or its gradient.

        Rows are those of :attr:`rows`: the elongations of all contacts, then their slips, twists
        and rolls, as far as motions make them and contacts resist them, and last the springs to the
        ground. Columns are mass-weighted motions: for each vector of the frame the motions of a
        ball, (x, y, w) in the plane. The first vector of the frame is the motion of the centre of
        mass, and rotations are divided by i. The matrix is real if the cell has one ball, its
        contacts have equal arms, and the ball touches no body that does not move.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        derivative : whether to return the gradient with respect to q instead.

        Returns
        -------
        (n_q, n_rows, n_branches), or (n_q, p, n_rows, n_branches) for the gradient.

        Raises
        ------
        InputError : wave vectors that are no real numbers, of another shape or not finite; the
            matrices at one wave vector do not fit into memory; or the lattice has no contacts.
        """
        waves = self._contact_waves
        rows = waves.compute_rows(as_wavevectors(wavevectors, self.periods), derivative)
        if not derivative:
            return rows
        # the derivative is by the half angle, whose gradient is the half vector
        return np.asarray(rows[:, None] * waves.repeat_half_vectors().T[None, :, :, None])

    @cached_property
    def rows(self) -> list[Row]:
        """Rows of the deformations that contacts resist, as coefficients of the motions of their
        two balls, u and w; where the motions deform no contact, as out of the plane without
        friction, one row of zeros.
        """
        zeros = np.zeros((len(self.contacts), self.motions.count))
        return self.make_rows(self.motions) or [Row("elongation", 1.0, zeros, zeros)]

    def make_rows(self, motions: Motions) -> list[Row]:
        """Return the rows of the deformations that contacts resist, as coefficients of the
        ``motions`` of their two balls, followed by those of springs to the ground.
        """
        ratios = (self.mindlin_ratio, self.torsion, self.bending)
        rows = self._make_contact_rows(motions, *ratios)
        if self.on_site is None:
            return rows
        return rows + anchor_rows(self.on_site, self.named_motions, motions, len(self.contacts))

    def _make_contact_rows(
        self, motions: Motions, slip: ArrayLike, twist: ArrayLike, roll: ArrayLike
    ) -> list[Row]:
        """Return the rows of the deformations of contacts, as coefficients of the ``motions`` of
        their two balls; entries of springs to the ground are zero.

        ``slip``, ``twist`` and ``roll``, numbers or (n_c,), are the stiffnesses over that of
        elongation; kinds without stiffness are left out.
        """
        table = self.contacts
        gyration_i, gyration_j = self._end_gyration
        rows = contact_rows(
            table.normal,
            table.arm_i,
            table.arm_j,
            motions,
            slip=slip,
            twist=twist,
            roll=roll,
            gyration_i=gyration_i,
            gyration_j=gyration_j,
        )
        for row in rows:  # springs to the ground have none of these deformations
            row.head[self.n_between :] = 0.0
            row.tail[self.n_between :] = 0.0
        return rows

    @cached_property
    def unit_rows(self) -> list[Row]:
        """Rows of all deformations of contacts that the motions of the balls can make, whether
        contacts resist them or not; then, if :attr:`is_prestressed`, those on which static normal
        forces act, and where there are such, those of levers of slip that exceed the arms and of
        tangential forces that grow.
        """
        table = self.contacts
        rows = self._make_contact_rows(self.motions, 1.0, 1.0, 1.0)
        if self.is_prestressed:
            rows += push_rows(table.normal, self.motions)
        if self.has_excesses:
            rows += excess_rows(*self._excess_arguments)
        if self.has_tangential_force and np.any(self.tangential_growth):
            rows += growth_rows(
                put_in_space(table.normal),
                put_in_space(self.tangential_force),
                (table.arm_i, table.arm_j),
                self.motions,
                self._end_gyration,
            )
        return rows

    @cached_property
    def _end_gyration(self) -> tuple[Array, Array]:
        """Radii of gyration, d, of balls i, (n_c,), and of balls j, (n_c,); 1 for a body that does
        not move.
        """
        gyration = np.append(self.gyration, 1.0)  # the last stands for a body that does not move
        return gyration[self.contacts.i], gyration[self.contacts.j]

    @property
    def shifts(self) -> Array:
        """(n_branches, n_u) displacements of all balls by the same vector, mass-weighted, as
        orthonormal columns. There are none, (n_branches, 0), if the lattice is held.
        """
        count = len(self.motions.translations)
        if self.is_held:
            return np.zeros((self.n_branches, 0))
        shifts = np.zeros((self.n_balls, self.motions.count, count))
        weights = np.sqrt(self.masses / self.masses.sum())
        shifts[:, np.arange(count), np.arange(count)] = weights[:, None]
        return shifts.reshape(self.n_branches, count)

    @property
    def _excess_arguments(self) -> tuple[Any, ...]:
        """The arguments of :func:`~granphon.dynamics.deformation_rows.excess_pairs`, in order."""
        table = self.contacts
        return (
            table.normal,
            (table.arm_i, table.arm_j),
            tuple(self.lever_excesses),
            self.slip_stretch,
            self.motions,
            self._end_gyration,
        )

    @cached_property
    def static_rows(self) -> list[tuple[Row, Array]]:
        """Rows on which static forces act, each with its stiffness (n_c,), which may be below zero.

        Displacements across a contact with the normal force f and the distance a of its centres
        have the stiffness -f/a. A tangential force acts by three products of two rows, by one more
        if the force grows with the overlap, and by one more if the force turns about the normal; a
        torque acts by three; slip by levers that exceed the arms acts by a product for each
        tangent. Each product is written as a difference of two squares, that is, by two rows.
        """
        normal = self.contacts.normal
        rows = [(row, -self.prestress) for row in push_rows(normal, self.motions)]
        if self.has_excesses:
            slip_stiffness = self.mindlin_ratio * self.stiffness
            pairs = excess_pairs(*self._excess_arguments)
            rows += [(row, sign * slip_stiffness) for row, sign in split_pairs(pairs)]
        # rows of torques and tangential forces of size one: the size becomes the stiffness
        if self.has_torque:
            unit_torque, size = _split_lengths(self.contact_torque)
            pairs = torque_pairs(
                normal, unit_torque, self.distance, self.motions, self._end_gyration
            )
            rows += [(row, sign * size) for row, sign in split_pairs(pairs)]
        if self.has_tangential_force:
            unit_force, size = _split_lengths(put_in_space(self.tangential_force))
            pairs = self._carry_unit_force(unit_force)
            rows += [(row, sign * size) for row, sign in split_pairs(pairs)]
        return rows

    def _carry_unit_force(self, unit_force: Array) -> list[tuple[Row, Row]]:
        """Return the pairs of rows of :func:`~granphon.dynamics.deformation_rows.carry_rows` of
        tangential forces of size one, ``unit_force`` (n_c, 3).
        """
        table = self.contacts
        return carry_rows(
            put_in_space(table.normal),
            unit_force,
            self.distance,
            (table.arm_i, table.arm_j),
            self.motions,
            self._end_gyration,
            growth=self.tangential_growth,
            arm_rates=self.arm_rates,
            turns=self.turns_with_balls,
        )

    def _weight_rows(self, are_static: bool = False) -> tuple[list[Row], Array]:
        """Return :attr:`rows`, and the square roots (kinds, n_c) of their stiffnesses, k^1/2.

        If ``are_static``, return :attr:`static_rows` and the square roots of the absolute values of
        their stiffnesses instead. Raises what :meth:`_require_contacts` raises.
        """
        self._require_contacts()
        if are_static:
            rows = [row for row, _ in self.static_rows]
            sizes = [np.abs(stiffness) for _, stiffness in self.static_rows]
            return rows, np.sqrt(sizes).reshape(len(rows), len(self.contacts))
        rows = self.rows
        stiffness = [row.stiffness * self.stiffness for row in rows]
        return rows, np.sqrt(stiffness).reshape(len(rows), len(self.contacts))

    def _combine_ends(
        self, rows: list[Row], root: Array, frame: Array | None = None
    ) -> tuple[Array, Array]:
        """Return head.x_j - tail.x_i and head.x_j + tail.x_i of ``rows`` for each motion of a real
        ``frame`` (n, n), by default :attr:`_frame`. The first column of the frame is the motion of
        the centre of mass.

        Both are (kinds, n_c, n_branches), and multiplied by ``root`` (kinds, n_c). The difference
        is the deformation at q = 0. For displacements of the centre of mass it is exactly zero,
        except in contacts with bodies that do not move.
        """
        # displacements of balls, instead of mass-weighted motions
        displacements = (self._frame if frame is None else frame) / np.sqrt(self.masses)[:, None]
        # exactly equal for all balls, so that the centre of mass deforms no contact
        displacements[:, 0] = 1.0 / np.sqrt(self.masses.sum())
        motion = np.pad(displacements, ((0, 1), (0, 0)))  # the last row: bodies that do not move
        # axes: kinds, contacts, columns of the frame, motions of a ball
        shape = (len(rows), len(self.contacts), 1, self.motions.count)
        head = np.reshape([row.head for row in rows], shape) * motion[self.contacts.j][:, :, None]
        tail = np.reshape([row.tail for row in rows], shape) * motion[self.contacts.i][:, :, None]
        difference = root[:, :, None, None] * (head - tail)
        total = root[:, :, None, None] * (head + tail)
        flat_shape = (*root.shape, self.n_branches)
        return difference.reshape(flat_shape), total.reshape(flat_shape)

    def _make_waves(self, are_static: bool = False) -> WaveRows:
        """Return the rows of C(q) in the motions of :attr:`_wave_frame`, multiplied by the square
        roots of their stiffnesses; if ``are_static`` those of :attr:`static_rows`. The rows are
        real for one ball in the cell, unless a contact has unequal arms or levers, joins the ball
        to a body that does not move, or bears a static torque that acts on motions.
        """
        # In a motion z exp(i q.r) a row is cos(half angle) times the difference of the effects of
        # its two ends, plus i sin(half angle) times their sum. Rotations and rows are divided by i.
        # Then both terms are real for one ball in the cell, because the difference vanishes for a
        # displacement, and the sum for the rotation in a slip. Rows of rotations alone (twist,
        # roll) are divided by i once more.
        rows, root = self._weight_rows(are_static)
        frame = self._wave_frame
        # each column of the frame is real or imaginary
        difference, total = self._combine_ends(rows, root, frame.real + frame.imag)
        phase_of_kind = {"twist": -1.0, "roll": -1.0, ANCHOR: 1.0}
        row_phases = np.array([phase_of_kind.get(row.kind, -1.0j) for row in rows])
        frame_phases = np.where(np.any(frame.imag, axis=0), 1.0j, 1.0)
        phase = row_phases[:, None, None] * np.kron(frame_phases, self.motions.phases)
        odd = 1j * phase * total
        even = phase * difference
        odd[:, self.n_between :] = 0.0  # springs to the ground have one end, and no half angle
        half = 0.5 * self.contacts.vector[:, : self.periods]
        # rows of a single ball are complex only in the cases that the docstring names
        if self.n_balls > 1 or np.any(odd.imag) or np.any(even.imag):
            return WaveRows(odd, even, half)
        return WaveRows(odd.real.copy(), even.real.copy(), half)

    @cached_property
    def _contact_waves(self) -> WaveRows:
        """Rows of C(q), one for each deformation of each contact."""
        return self._make_waves()

    @cached_property
    def _images(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]] | None:
        """An inversion that maps the lattice onto itself: the image (n,) of each ball, one contact
        (m,) of each pair of contacts that are images of each other, and its image (m,). None if
        there is no such inversion, if there are no contacts, and if balls touch bodies that do not
        move or springs to the ground, among which none is sought.

        The image of a contact from i to j joins the images of j and i by the same vector. Contacts
        that are their own images are not among the m.
        """
        has_fixed_ends = np.any(self.contacts.j == self.n_balls)
        if has_fixed_ends or not len(self.contacts):
            return None
        balls, rounding = self._describe_balls()
        is_like_first = np.all(np.abs(balls - balls[0]) <= rounding * balls, axis=1)
        for candidate in np.flatnonzero(is_like_first):
            inversion = self._invert_balls(int(candidate))
            if inversion is None:
                continue
            image, cells = inversion
            is_involution = np.array_equal(image[image], np.arange(self.n_balls))
            have_equal_images = np.all(np.abs(balls[image] - balls) <= rounding * balls)
            if not is_involution or not have_equal_images:
                continue
            contact_images = self._invert_contacts(image, cells)
            if contact_images is not None:
                one_of_pair = np.flatnonzero(contact_images > np.arange(len(contact_images)))
                return image, one_of_pair, contact_images[one_of_pair]
        return None

    def _describe_balls(self) -> tuple[Array, Array]:
        """Return numbers (n, 4) of each ball, none below zero, that its image has too, and their
        roundings (4,): mass, radius of gyration, and the sums of the stiffnesses and of the sizes
        of the static forces of its contacts.
        """
        table = self.contacts
        sums = [
            np.bincount(table.i, sizes, self.n_balls) + np.bincount(table.j, sizes, self.n_balls)
            for sizes in (self.stiffness, np.abs(self.prestress))
        ]
        balls = np.column_stack([self.masses, self.gyration, *sums])
        return balls, np.repeat([_ROUNDING, _REST_ROUNDING], 2)

    def _invert_balls(
        self, image_of_first: int
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
        """Return the image (n,) of each ball under the inversion that takes ball 0 to the ball
        number ``image_of_first``, and the cell (n, p) in which the image lies; None if a ball is
        taken to where no ball is.
        """
        p = self.periods
        n = self.n_balls
        size = np.abs(self.positions).max() + np.abs(self.cell).max()
        inverse = np.linalg.inv(self.cell[:, :p])
        target = self.positions[0] + self.positions[image_of_first] - self.positions
        # most inversions that fail do so for the first few balls, which are tried before all
        for count in (min(n, 4), n):
            offset = target[:count, None] - self.positions  # from each ball to each target
            cells = np.rint(offset[..., :p] @ inverse)
            error = np.max(np.abs(offset - cells @ self.cell), axis=2)
            image = np.argmin(error, axis=1)
            if np.any(error[np.arange(count), image] > _CENTRE_TOLERANCE * size):
                return None
        return image, cells[np.arange(n), image].astype(np.intp)

    def _invert_contacts(
        self, image: NDArray[np.intp], cells: NDArray[np.intp]
    ) -> NDArray[np.intp] | None:
        """Return the image (n_c,) of each contact under an inversion of the balls, whose ``image``
        (n,) and ``cells`` (n, p) are those of :meth:`_invert_balls`; None if a contact has no
        image, or an image with other properties.
        """
        table = self.contacts
        i = image[table.j]
        j = image[table.i]
        shift = table.shift + cells[table.i] - cells[table.j]
        # an image is straight if the table lists it from the image of ball j to that of ball i, and
        # not the other way round
        contact_keys = np.column_stack([table.i, table.j, table.shift]).tolist()
        numbers = {tuple(key): contact for contact, key in enumerate(contact_keys)}
        straight_images = _look_up(numbers, i, j, shift)
        is_straight = straight_images >= 0
        images = np.where(is_straight, straight_images, _look_up(numbers, j, i, -shift))
        if np.any(images < 0) or np.any(images[images] != np.arange(len(table))):
            return None
        if self._have_equal_properties(images, is_straight):
            return images
        return None

    def _have_equal_properties(
        self, images: NDArray[np.intp], is_straight: NDArray[np.bool_]
    ) -> bool:
        """Return whether the image of each contact has the same stiffnesses, arms, forces and
        vectors, but for rounding.

        ``images`` (n_c,) are the numbers of the images, and ``is_straight`` (n_c,) says which of
        them the table lists from the image of ball j to that of ball i.
        """
        table = self.contacts
        ratios = [
            np.broadcast_to(ratio, len(table))
            for ratio in (self.mindlin_ratio, self.torsion, self.bending)
        ]
        scalars = np.array(
            [
                self.stiffness,
                self.prestress,
                self.slip_stretch,
                self.arm_rates,
                self.tangential_growth,
                *ratios,
            ]
        )
        if np.any(np.abs(scalars[:, images] - scalars) > _REST_ROUNDING * np.abs(scalars)):
            return False
        # what belongs to the ends i and j, (2, 2, n_c), is exchanged where the image is straight
        ends = np.array([(table.arm_i, table.arm_j), self.lever_excesses])
        image_ends = np.where(is_straight, ends[:, ::-1, images], ends[:, :, images])
        if np.any(np.abs(image_ends - ends) > _REST_ROUNDING * np.abs(ends)):
            return False
        # a straight image has the same vectors, and any other the opposite ones; centres are
        # rounded in proportion to their distance from the origin
        size = np.abs(self.positions).max() + np.abs(self.cell).max()
        largest_force = float(np.max(np.abs(self.tangential_force), initial=0.0))
        largest_torque = float(np.max(np.abs(self.contact_torque), initial=0.0))
        sign = np.where(is_straight, 1.0, -1.0)[:, None]
        for vectors, largest, factor in (
            (table.vector, max(size, 1.0), sign),
            (table.normal, 1.0, sign),
            (self.tangential_force, largest_force, sign),
            # an inversion leaves torques as they are
            (self.contact_torque, largest_torque, -sign),
        ):
            if np.any(np.abs(factor * vectors[images] - vectors) > _REST_ROUNDING * largest):
                return False
        return True

    @cached_property
    def _wave_frame(self) -> NDArray[Any]:
        """(n, n) unitary frame of vibrations: :attr:`_frame`, unless balls are images of other
        balls under an inversion. Then its columns are even and odd combinations of their motions,
        the odd ones multiplied by i, so that the rows of a contact and of its image are complex
        conjugates but for the sign.

        In both cases the first column is the motion of the centre of mass.
        """
        # before images are sought, which takes long among many contacts
        self._require_memory(self.bytes_per_wavevector)
        n = self.n_balls
        if self._images is None or np.array_equal(self._images[0], np.arange(n)):
            return self._frame
        image = self._images[0]
        self_images = np.flatnonzero(image == np.arange(n))  # balls that are their own images
        first_balls = np.flatnonzero(image > np.arange(n))  # one ball of each pair of images
        second_balls = image[first_balls]
        unit = np.eye(n)
        sums = np.sqrt(0.5) * (unit[:, first_balls] + unit[:, second_balls])
        even = np.concatenate([unit[:, self_images], sums], axis=1)
        centre_of_mass = np.sqrt(self.masses / self.masses.sum())
        n_even = n - len(first_balls)
        frame = np.zeros((n, n), complex)
        frame[:, :n_even] = even @ self._complete(even.T @ centre_of_mass)
        frame[:, n_even:] = 1j * np.sqrt(0.5) * (unit[:, first_balls] - unit[:, second_balls])
        return frame

    @cached_property
    def _wave_contacts(self) -> NDArray[np.intp]:
        """(n_c,) index of the contact whose half angle each row of :attr:`_deforming` contains."""
        contacts = np.arange(len(self.contacts))
        if self._images is not None:
            _, first_contacts, image_contacts = self._images
            contacts[image_contacts] = first_contacts
        return contacts

    def _make_real_waves(self, are_static: bool = False) -> WaveRows:
        """Return rows with the same C^H C as those of :meth:`_make_waves`, to which ``are_static``
        is passed on; they are real if an inversion maps the lattice onto itself.

        The row of the image of a contact is plus or minus the complex conjugate of the contact's
        row. The two are replaced by 2^1/2 times the real part and 2^1/2 times the imaginary part of
        the contact's row.
        """
        waves = self._make_waves(are_static)
        # with an inversion, rows of one ball in the cell are real as they are
        if self.n_balls == 1 or self._images is None:
            return waves
        _, first_contacts, image_contacts = self._images
        factors = np.ones((len(self.contacts), 1))
        factors[[first_contacts, image_contacts]] = np.sqrt(2.0)
        odd = waves.odd.real * factors
        even = waves.even.real * factors
        # the row of the image becomes the imaginary part
        odd[:, image_contacts] = np.sqrt(2.0) * waves.odd.imag[:, first_contacts]
        even[:, image_contacts] = np.sqrt(2.0) * waves.even.imag[:, first_contacts]
        return WaveRows(odd, even, waves.half[self._wave_contacts])

    @cached_property
    def _deforming(self) -> WaveRows:
        """Rows with the C^H C of C(q), real if an inversion maps the lattice onto itself."""
        return self._make_real_waves()

    @cached_property
    def _pushing(self) -> WaveRows:
        """Rows on which static forces act, real where those of :attr:`_deforming` are."""
        return self._make_real_waves(are_static=True)

    @cached_property
    def static_signs(self) -> Array:
        """(kinds, n_c) sign with which the square of each row of :attr:`static_rows` is subtracted
        from D.
        """
        return -np.sign([stiffness for _, stiffness in self.static_rows]).reshape(
            -1, len(self.contacts)
        )

    @cached_property
    def _push_signs(self) -> Array:
        """(kinds, n_c) signs of the rows of :attr:`_pushing`: those of :attr:`static_signs`, where
        the row of an image has the sign of the contact whose image it is.
        """
        return self.static_signs[:, self._wave_contacts]

    def _compute_frame_matrix(self, wavevectors: ArrayLike) -> NDArray[Any]:
        """Return D(q) (n_q, n_branches, n_branches), k/M, in the motions of :attr:`_wave_frame`,
        with the effect of static forces; ``wavevectors`` are (n_q, p), 1/d. Raises what
        :meth:`compatibility` raises.
        """
        q = as_wavevectors(wavevectors, self.periods)
        rows = self._deforming.compute_rows(q)
        matrix = rows.conj().swapaxes(1, 2) @ rows
        if self.is_prestressed:
            push_rows_at_q = self._pushing.compute_rows(q)
            signs = self._push_signs.reshape(-1, 1)
            matrix = matrix - push_rows_at_q.conj().swapaxes(1, 2) @ (signs * push_rows_at_q)
        return np.asarray(matrix)

    def damped_matrices(
        self, wavevectors: ArrayLike, times: Array, factors: Array, drags: Array
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the complex D(q), k/M, with the loss factors of contacts, and the matrix of
        dashpots and drag, (k/M)^1/2; each is (n_q, n_branches, n_branches), in the motions of
        :attr:`_wave_frame`.

        ``wavevectors`` are (n_q, p), 1/d. ``times``, (M/k)^1/2, and ``factors`` are (2, n_between)
        arrays for the contacts without springs to the ground: of their elongations, and of their
        other deformations. ``drags`` (motions,), (k/M)^1/2, are those of the motions of a ball; see
        :class:`granphon.dynamics.damping.Losses`. Springs to the ground lose no energy. Raises
        what :meth:`compatibility` raises.
        """
        rows = self.compatibility(wavevectors)
        adjoint = rows.conj().swapaxes(1, 2)
        n_springs = len(self.contacts) - self.n_between

        def weigh(numbers: Array) -> NDArray[Any]:
            """Return M^-1/2 C^H K W C M^-1/2, where the weights W are ``numbers`` (2, n_between),
            of elongations and of other deformations, and zero for springs.
            """
            weights = weigh_rows(self.rows, np.pad(numbers, ((0, 0), (0, n_springs))))
            return np.asarray(adjoint @ (weights.reshape(-1, 1) * rows))

        viscous = weigh(times) + np.diag(np.tile(drags, self.n_balls))
        return self._compute_frame_matrix(wavevectors) + 1j * weigh(factors), viscous

    @cached_property
    def _to_balls(self) -> NDArray[np.complex128]:
        """(n_branches, n_branches) unitary matrix from the motions of :attr:`_wave_frame`, with
        rotations divided by i, to the mass-weighted motions of each ball.
        """
        return np.asarray(np.kron(self._wave_frame, np.diag(self.motions.phases)), complex)

    def dynamical_matrix(self, wavevectors: ArrayLike) -> NDArray[np.complex128]:
        """Return the Hermitian D(q) = M^-1/2 C^H K C M^-1/2, (n_q, n_branches, n_branches), in
        units of k/M, with the effect of static forces if there are any.

        Rows and columns are the motions, (x, y, w) in the plane, of the first ball, then those of
        the second, and so on. Phases are taken at the positions of the balls, as in phonopy.
        ``wavevectors`` (n_q, p) are in 1/d. Raises what :meth:`compatibility` raises.
        """
        return np.asarray(
            self._to_balls @ self._compute_frame_matrix(wavevectors) @ self._to_balls.conj().T
        )

    # -- in SI -------------------------------------------------------------------------------------

    def contact_network(
        self, units: Units, normal_force: ArrayLike = 0.0, radii: ArrayLike = 0.5, **fields: Any
    ) -> ContactNetwork:
        """Return balls and contacts of one cell as a
        :class:`~granphon.networks.network.ContactNetwork`, in SI.

        Parameters
        ----------
        units : the scales d (m), k (N/m) and M (kg).
        normal_force : (n_c,) compressive forces, over k d.
        radii : (n,) radii of the balls, over d.
        fields : further fields of the network, or other values of its ``motions``, ``prestress``,
            ``pbc``, ``positions``, ``tangential_force`` and ``contact_torque``. How tangential
            forces and levers of slip change follows from fields of the network, and not from this
            lattice.

        Raises
        ------
        InputError : balls touch bodies that do not move, or springs to the ground hold balls, as
            the network would lack these bodies and springs; ``units`` that are none; forces or
            radii that are no finite numbers, or of a wrong shape; a field that the network does not
            have, or that follows from the lattice; and what the network refuses.
        """
        require_instance("units", units, Units, "Give gp.Units(length, stiffness, mass)")
        if np.any(self.contacts.j == self.n_balls):
            raise InputError(
                "the lattice has contacts with bodies that do not move, or with the ground",
                "Its balls alone are no network that holds those contacts",
                "Use the network that the lattice was made from",
            )
        defaults: dict[str, Any] = {
            "motions": self.named_motions.name,
            "prestress": self.is_prestressed,
            "pbc": tuple(axis < self.periods for axis in range(3)),
            "positions": units.length * put_in_space(self.positions),
        }
        if self.is_prestressed:
            defaults["tangential_force"] = units.force * put_in_space(self.tangential_force)
            if np.any(self.contact_torque):
                defaults["contact_torque"] = units.force * units.length * self.contact_torque
        fields_of_lattice = self._list_network_fields(units, normal_force, radii)
        all_names = {entry.name for entry in list_fields(ContactNetwork)}
        further_names = all_names - fields_of_lattice.keys()
        for name in fields:
            if name not in further_names:
                why = "The lattice gives this field, or no network has it"
                mend = f"Give one of {', '.join(sorted(further_names))}"
                raise InputError(f"{name} is no further field of the network", why, mend)
        return ContactNetwork(**fields_of_lattice, **(defaults | fields))

    def _list_network_fields(
        self, units: Units, normal_force: ArrayLike, radii: ArrayLike
    ) -> dict[str, Any]:
        """Return the fields of a network, in SI, that follow from this lattice alone; the arguments
        are those of :meth:`contact_network`.

        Raises :class:`~granphon.base.errors.InputError` for forces or radii of a wrong shape, or
        not finite.
        """
        table = self.contacts
        count = len(table)
        d = units.length
        p = self.periods
        # networks have three components also in the plane
        cell = np.zeros((3, 3))
        shift = np.zeros((count, 3), np.intp)
        cell[:p, : self.dimension] = d * self.cell
        shift[:, :p] = table.shift
        masses = units.mass * self.masses
        normal_stiffness = units.stiffness * self.stiffness
        return {
            "cell": cell,
            "radii": d * _repeat("radii", radii, (self.n_balls,)),
            "masses": masses,
            "inertias": masses * (d * self.gyration) ** 2,
            "i": table.i,
            "j": table.j,
            "shift": shift,
            "normal": put_in_space(table.normal),
            "normal_force": units.force * _repeat("normal_force", normal_force, (count,)),
            "normal_stiffness": normal_stiffness,
            "shear_stiffness": self.mindlin_ratio * normal_stiffness,
            "torsion_stiffness": self.torsion * d * d * normal_stiffness,
            "bending_stiffness": self.bending * d * d * normal_stiffness,
            "arm_i": d * table.arm_i,
            "arm_j": d * table.arm_j,
            "dimension": self.dimension,
        }


def _split_lengths(vectors: Array) -> tuple[Array, Array]:
    """Return the unit vectors (n, 3) along ``vectors`` (n, 3), zero for a vector of length zero,
    and the lengths (n,) of the vectors.
    """
    length = np.linalg.norm(vectors, axis=1)
    has_length = length[:, None] > 0.0
    units = np.divide(vectors, length[:, None], out=np.zeros_like(vectors), where=has_length)
    return units, length


def _look_up(
    numbers: dict[tuple[int, ...], int], i: Index, j: Index, shift: Index
) -> NDArray[np.intp]:
    """Return the numbers (m,) of contacts from balls ``i`` (m,) to balls ``j`` (m,) in the cells
    ``shift`` (m, p); -1 where there is no such contact. ``numbers`` has the number of each contact
    of the table, by its (i, j, *shift).
    """
    keys = np.column_stack([i, j, shift]).tolist()
    return np.array([numbers.get(tuple(key), -1) for key in keys], np.intp)
