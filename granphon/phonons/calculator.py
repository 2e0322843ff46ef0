"""The ASE calculator for balls in contact, and the ``ase.Atoms`` of one cell of a lattice.

Atoms are in reduced units and have the arrays of :mod:`granphon.array.atoms`. A pair of balls is
identified with the contact of the lattice whose vector is nearest to that of the pair. The
direction of this contact is the reference direction of the pair. So reference positions need not be
stored, and slip does not change when all balls are moved together.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np
from ase import Atoms
from ase.calculators.calculator import all_changes

from granphon.array.atoms import (
    ARRAYS,
    FINITE,
    LATTICE,
    SAMPLE,
    adopt,
    count_coordinates,
    find_kind,
    has_masses,
    has_sampled,
    require_lying,
    take_arrays,
)
from granphon.balls.contact_model import ContactModel
from granphon.balls.lattices import BALL
from granphon.balls.motions import (
    ALL,
    IN_PLANE,
    LONGITUDINAL,
    OUT_OF_PLANE,
    Motions,
    allowed_motions,
    select_motions,
)
from granphon.balls.neighbours import TOUCH, find_pairs, freeze_contacts
from granphon.balls.packing import MINDLIN
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, PrecisionError, brief
from granphon.base.memory import require_memory
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import is_one_of, one_of, require_instance
from granphon.dynamics.compatibility import GYRATION, put_in_space
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.deformation_rows import Row, contact_rows
from granphon.media.state import ContactState, Law, NetworkState, as_state, given_state
from granphon.networks.network import ContactNetwork
from granphon.phonons.ball_contacts import (
    LEAST_EXTENT,
    BallContacts,
    ContactCalculator,
    list_stress,
    require_apart,
    require_independent,
)
from granphon.phonons.phonopy_atoms import name_balls, name_symbols, place_in_space

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from granphon.contacts.placed import ContactForces


#: least delta/d at which double-precision positions still hold six digits of the overlap
_LEAST_OVERLAP = 1e-10
#: largest displacement of two balls in contact against each other along an axis, in diameters, for
#: which a harmonic energy is found
_LARGEST_DISPLACEMENT = 0.5
#: all motions of balls that have 1, 2 or 3 coordinates
_MOTIONS = (LONGITUDINAL, IN_PLANE, ALL)
#: words for the measure of the cell of a lattice with 1, 2 or 3 periods
_EXTENTS = ("length along x", "area in the plane", "volume")
#: greatest distance, in diameters, between the vector of a pair and a contact vector of the lattice
#: for the pair to count as that contact
_CATCH = 0.25
#: greatest rotation of the whole lattice that is accepted when energies are found, measured by the
#: overlap that the rotation would add to contacts of fixed direction, over their overlap
_TURN_PER_OVERLAP = 1e-2
#: greatest rotation of the whole lattice that is accepted when force constants are found, as added
#: overlap over the spacing. More is allowed, because positions then only tell which balls touch
_TURN_PER_SPACING = 1e-4
#: eigenvalue of the sum of the projections across contacts, over the largest, up to which the
#: contacts show no rotation about its axis
_NO_ROTATION = 1e-9
#: distance, in diameters, by which a list of pairs reaches beyond the cutoff. A list serves until a
#: ball has moved by half of this distance. On the triangular lattice a list reaches 1.55, and so no
#: second neighbours, which are at 1.73
_SKIN = 0.3


def atoms(state: Any) -> Atoms:
    """Return one cell of the lattice in ``state`` as an ``ase.Atoms`` with :class:`HertzMindlin`
    attached.

    Lengths and masses are in reduced units. The cell is primitive, with Cartesian axes along the
    cube of cubic lattices; for the triangular lattice it is ASE's HEX2D cell (120 degrees). A
    lattice of fewer than three periods lies along x, or in the xy plane; across it the cell is one
    diameter thick and not periodic. With finite overlap the cell has the spacing a = d - delta.
    The Atoms have the arrays of a file ``sample.extxyz``.

    For the state of a crystal, of a sample or of a :class:`~granphon.ContactNetwork` with periods
    the cell is that of its network. The Atoms are then the balls that move, with their masses,
    radii (the array ``radius``), a chemical symbol for each kind, and the scales in ``info``. A
    kind whose name is a chemical symbol, but for "No", has that symbol; ``info["kinds"]`` has the
    name of each symbol. If kinds are not known, or more than symbols, each mass has a symbol of its
    own; more than 12 masses have one. The calculator is :class:`HarmonicContacts`, as a network has
    stiffnesses and no contact law.

    Raises :class:`~granphon.base.errors.InputError` for what has no network, if the state holds
    several loads, and for a network without a period.
    """
    any_state: Any = as_state(state)
    if not any_state.follows_law:
        return _make_network_atoms(any_state)
    contact_state = given_state(any_state)
    packing = contact_state.packing
    spacing = 1.0
    kind = LATTICE
    if contact_state.finite_overlap:
        spacing = 1.0 - contact_state.relative_overlap
        kind = FINITE
    structure = packing.structure
    balls = _place_balls(structure.vectors * spacing, structure.positions * spacing)
    take_arrays(balls, contact_state.scales, kind, coordinates=count_coordinates(packing))
    balls.calc = HertzMindlin(contact_state)
    return balls


def _place_balls(vectors: Array, positions: Array) -> Atoms:
    """Return Atoms at ``positions`` (n, d) that repeat along ``vectors`` (p, d), in three
    dimensions; the cell is one diameter thick across the periods.
    """
    cell, in_space = place_in_space(vectors, positions)
    return Atoms(
        [BALL] * len(in_space), positions=in_space, cell=cell, pbc=np.arange(3) < len(vectors)
    )


def _make_network_atoms(state: NetworkState) -> Atoms:
    """Return the moving balls of the network of a ``state`` as Atoms in reduced units, as
    :func:`atoms` describes them, with the calculator :class:`HarmonicContacts`.
    """
    lattice = state.contact_lattice()
    network = state.network
    kinds = state.kinds
    balls = _place_balls(lattice.cell, lattice.positions)
    balls.symbols = name_balls(lattice.masses, kinds)
    balls.set_masses(lattice.masses)
    balls.set_array("radius", network.radii[network.moving] / state.scales.length)
    balls.info.update(state.scales.to_info())
    names = name_symbols(kinds)
    if names:
        balls.info["kinds"] = names
    axes = lattice.motions.rotations
    if axes == (2,):  # balls turn about z alone
        balls.set_array("rotations", np.zeros(len(balls)))
    elif axes:
        balls.set_array("rotations", np.zeros((len(balls), 3)))
    balls.calc = HarmonicContacts(state, balls)
    return balls


class HarmonicContacts(ContactCalculator):
    """ASE calculator of a network of contacts, to second order about its state, in the reduced
    units of the network.

    The energy is counted from that of the state, and has two parts. The first is V S:(F - 1), with
    the volume V of the cell, the stress S of the normal forces, and the deformation F of the cell.
    The second is a sum over contacts: k e^2/2 + kappa s^2/2 + k_t twist^2/2 + k_b roll^2/2, where e
    is the elongation and s the slip, and with prestress less f t^2/(2 r), where t is the
    displacement across the contact and r the distance of the centres. Springs to the ground add
    g u^2/2 and g phi^2/2. Static tangential forces, and slip by levers that exceed the arms, add
    the part of their energy that has a potential. Forces and torques are zero at rest,
    and their derivatives are the dynamical matrix of :class:`~granphon.Phonons`. Contacts neither
    open nor stiffen, so that displacements must be small against the overlap. Stress is defined as
    for :class:`HertzMindlin`. Rotations, about the axes of the motions, are read from the array
    ``rotations``.

    :func:`~granphon.atoms` attaches the calculator to the Atoms of a network, whose positions it
    keeps as those at rest. The calculator serves the same balls in the same order; the Atoms
    ``gp.atoms(network.repeat(...))`` of a larger cell have a calculator of their own. Raises
    :class:`~granphon.base.errors.InputError` for other Atoms, for numbers that are not finite, for
    a cell whose vectors are not independent, for an array ``rotations`` of another shape, for balls
    in contact that have moved against each other by more than half a diameter along an axis, and
    for a stress where bodies without motion, or springs to the ground, hold the balls.
    """

    follows = ("rotations",)

    def __init__(self, state: NetworkState, reference: Atoms) -> None:
        """Keep the ``state``, and a copy of ``reference``, the Atoms at rest."""
        super().__init__()
        self.state = state
        self._reference = reference.copy()

    def calculate(
        self,
        atoms: Atoms | None = None,
        properties: Any = ("energy",),
        system_changes: Any = all_changes,
    ) -> None:
        """Set ``results``, a dictionary: the energy, k d^2, the forces (N, 3), k d, and the stress
        (6,), k/d, of the atoms; keep the torques for :meth:`get_torques`. A network that bodies
        without motion, or springs to the ground, hold has no stress.

        ASE gives the names of the ``properties`` that it asks for, and of the ``system_changes``
        since the last call.

        Raises :class:`~granphon.base.errors.InputError` as the class says.
        """
        from granphon.contacts.placed import ContactForces  # bands do not need it

        lattice = self.state.contact_lattice()
        if lattice.is_held and "stress" in properties:
            raise InputError(
                "a network that is held has no stress of its own",
                "Bodies without motion, or springs to the ground, bear a part",
                "Take energy or forces",
            )
        super().calculate(atoms, properties, system_changes)
        balls = self.atoms
        self.contact_network(balls)  # raises for other Atoms
        table = lattice.contacts
        n = len(balls)
        displacement = self._find_displacements(balls)
        rotations = self._find_rotations(balls)
        vector = put_in_space(table.vector) + displacement
        # a body that does not move comes after the balls
        contacts = ContactForces(table.i, table.j, vector, n + 1, lattice.motions)
        for row, stiffness in _list_springs(lattice):
            contacts.resist(row, stiffness, displacement, rotations)
        forces, virial = contacts.collect()
        torques = contacts.torque[:n] * lattice.gyration[:, None]
        self._torques: Array = np.zeros((n, 3))
        self._torques[:, list(lattice.motions.rotations)] = torques
        # the work of the static stress, V s:(F - 1)
        static = self._find_static_stress()
        cell = self._reference.cell.array
        strain = np.linalg.solve(cell, balls.cell.array - cell)  # F - 1
        energy = contacts.energy + float(np.sum(static * strain))
        self.results = {"energy": energy, "free_energy": energy, "forces": forces[:n]}
        if not lattice.is_held:
            p = lattice.periods
            # across the periods the cell is one diameter thick
            volume = abs(np.linalg.det(balls.cell.array[:p, :p]))
            stress = (static + strain.T @ static - virial) / volume
            self.results["stress"] = list_stress(stress)

    def _find_displacements(self, balls: Atoms) -> Array:
        """Return the displacement (n_c, 3), in diameters, of ball j of each contact against ball i,
        from the positions at rest to those of ``balls``.

        Raises :class:`~granphon.base.errors.InputError` for a displacement that is not small, for a
        position or cell that is not finite, and for a cell whose vectors are not independent.
        """
        if not (np.all(np.isfinite(balls.positions)) and np.all(np.isfinite(balls.cell.array))):
            raise InputError("the Atoms hold a number that is not finite, in positions or cell")
        vectors = balls.cell.array
        require_independent(vectors[np.any(vectors, axis=1)])  # ASE replaces vectors of zeros
        reference = self._reference
        lattice = self.state.contact_lattice()
        table = lattice.contacts
        n = len(balls)
        # displacements of the balls without whole periods; the last row, of zeros, is that of
        # bodies that do not move
        displacements = np.zeros((n + 1, 3))
        fractions = balls.get_scaled_positions(wrap=False)
        fractions_at_rest = reference.get_scaled_positions(wrap=False)
        steps = np.rint(fractions - fractions_at_rest) * balls.pbc
        displacements[:n] = balls.positions - steps @ balls.cell - reference.positions
        change_of_periods = (balls.cell - reference.cell)[: lattice.periods]
        displacement = displacements[table.j] - displacements[table.i]
        displacement = displacement + table.shift @ change_of_periods
        if np.max(np.abs(displacement), initial=0.0) > _LARGEST_DISPLACEMENT:
            raise InputError(
                f"balls in contact have moved against each other by more than"
                f" {_LARGEST_DISPLACEMENT} diameters",
                "Displacements must be small",
                "Compare the order of the balls, and the cell",
            )
        return np.asarray(displacement)

    def _find_rotations(self, balls: Atoms) -> Array:
        """Return w = R_g phi (n + 1, r), in diameters, of the n ``balls`` about the r axes of their
        motions; the last row, of zeros, is that of bodies that do not move. R_g is the radius of
        gyration of a ball, and phi its rotation, rad, zero without an array ``rotations``.

        Raises :class:`~granphon.base.errors.InputError` for an array of another shape than (n, 3),
        or (n,) if balls turn about one axis, and for a number that is not finite.
        """
        lattice = self.state.contact_lattice()
        axes = list(lattice.motions.rotations)
        n = len(balls)
        angles = balls.arrays.get("rotations", np.zeros((n, 3)))
        is_about_one_axis = angles.shape == (n,) and len(axes) == 1
        if not is_about_one_axis and angles.shape != (n, 3):
            shapes = f"({n},) or ({n}, 3)" if len(axes) == 1 else f"({n}, 3)"
            raise InputError(
                f"the array rotations has the shape {angles.shape}", mend=f"Give {shapes}"
            )
        if not np.all(np.isfinite(angles)):
            raise InputError("the array rotations holds a number that is not finite")
        about_axes = angles[:, None] if is_about_one_axis else angles[:, axes]
        rotations = np.zeros((n + 1, len(axes)))
        rotations[:n] = lattice.gyration[:, None] * about_axes
        return rotations

    def _find_static_stress(self) -> Array:
        """Return the stress of the normal forces times the volume of the cell, (3, 3), k d^2."""
        from granphon.contacts.placed import ContactForces  # bands do not need it

        lattice = self.state.contact_lattice()
        table = lattice.contacts
        network = self.state.network
        sizes = network.normal_force[network.in_lattice] / self.state.scales.force
        # springs to the ground come after the contacts, and bear no static force
        rows = slice(len(sizes))
        vectors = np.ascontiguousarray(put_in_space(table.vector[rows]))
        ends = (table.i[rows], table.j[rows])
        contacts = ContactForces(*ends, vectors, lattice.n_balls + 1, lattice.motions)
        contacts.press(sizes, put_in_space(table.normal[rows]))
        # compressive forces are above zero, and make a stress below zero
        return -contacts.collect()[1].T

    def get_torques(self, atoms: Atoms) -> Array:
        """Return the torques (N, 3) on the balls of ``atoms``, -dE/dphi, k d^2, zero about axes
        about which no ball turns. Raises :class:`~granphon.base.errors.InputError` as the class
        says.
        """
        self.get_property("energy", atoms)
        return self._torques.copy()

    def contact_network(self, atoms: Atoms) -> ContactNetwork:
        """Return the network of the state, whose balls ``atoms`` must be.

        Raises :class:`~granphon.base.errors.InputError` for what are no Atoms, and for Atoms of
        another number, or with other periods or masses.
        """
        require_instance("atoms", atoms, Atoms, "Give an ase.Atoms")
        reference = self._reference
        have_periods = np.array_equal(atoms.pbc, reference.pbc)
        have_masses = np.array_equal(atoms.get_masses(), reference.get_masses())
        if not (have_periods and have_masses):
            raise InputError(
                f"the Atoms are not the {counted(len(reference), 'ball')} of the network",
                "Its calculator serves these alone",
                "Use gp.atoms(network.repeat(...)), or of another network",
            )
        return self.state.network


class Pairs(NamedTuple):
    """n pairs of balls, each once; a ball has m = 1, 2 or 3 coordinates.

    Attributes
    ----------
    i, j : (n,) numbers of the two balls.
    shift : (n, m) numbers of cells by which the image of ball j is shifted.
    vector : (n, m) vector from ball i to the image of ball j, in diameters.
    """

    i: Index
    j: Index
    shift: Index
    vector: Array


def keep_rows(is_kept: Flags, *arrays: Any) -> tuple[Any, ...]:
    """Return the rows of each of the ``arrays`` (n, ...) for which ``is_kept`` (n,) is true; the
    arrays themselves if all rows are kept.
    """
    return arrays if is_kept.all() else tuple(array[is_kept] for array in arrays)


class _PairSearch(NamedTuple):
    """The result of a search for pairs of balls; lengths are in diameters.

    Attributes
    ----------
    pairs : all pairs nearer than ``reach``.
    positions : (N, m) positions of the balls.
    cell : (m, m) vectors of the cell, as rows.
    periodic : (m,) whether the balls repeat along each vector.
    reach : distance up to which pairs were sought.
    """

    pairs: Pairs
    positions: Array
    cell: Array
    periodic: tuple[bool, ...]
    reach: float

    def serves(
        self, positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float
    ) -> bool:
        """Return whether ``pairs`` contains all pairs nearer than ``cutoff`` at these positions
        (N, m), in this cell (m, m) that repeats along the ``periodic`` (m,) of its vectors.

        A change of the cell multiplies all vectors by a matrix F. Let s be the smallest singular
        value of F. Balls that were farther apart than the reach are then at least as far apart as s
        times the reach, less twice the greatest distance that a ball has moved in addition.
        """
        if positions.shape != self.positions.shape or periodic != self.periodic:
            return False
        expected: Any = self.positions
        stretch = 1.0
        if not np.array_equal(cell, self.cell):
            # F; a matrix of zeros, with which no list serves, if the old cell cannot be inverted
            change: Any = np.zeros_like(cell)
            if abs(np.linalg.det(self.cell)) >= LEAST_EXTENT:
                change = np.linalg.solve(self.cell, cell)
            stretch = float(np.linalg.svd(change, compute_uv=False)[-1])
            expected = expected @ change
        displacement = positions - expected
        squares = np.einsum("na,na->n", displacement, displacement)
        farthest = float(np.sqrt(np.max(squares, initial=0.0)))
        return stretch * self.reach - 2.0 * farthest >= cutoff


def _search_pairs(
    positions: Array, cell: Array, periodic: tuple[bool, ...], reach: float
) -> _PairSearch:
    """Return the pairs of balls at ``positions`` (N, m) nearer than ``reach``, in diameters.

    The periods are those rows of the ``cell`` (m, m) for which ``periodic`` (m,) is true. Raises
    :class:`~granphon.base.errors.InputError` for a period without length, and for periods that are
    not independent of each other.
    """
    axes = np.flatnonzero(periodic)
    periods = cell[axes]
    require_independent(periods)
    i, j, steps, vector = find_pairs(positions, periods, reach)
    shift = np.zeros((len(i), len(cell)), np.intp)
    shift[:, axes] = steps
    pairs = Pairs(i, j, shift, vector)
    return _PairSearch(pairs, positions.copy(), cell.copy(), periodic, reach)


class PairList:
    """A search for pairs of balls that keeps its list of pairs. The list reaches beyond the cutoff,
    and is used again until it might miss a pair.
    """

    def __init__(self) -> None:
        """Begin without a list."""
        self._last_search: _PairSearch | None = None

    def near(
        self, positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float
    ) -> Pairs:
        """Return the pairs nearer than ``cutoff``, in the order of (i, j, shift); all lengths are
        in diameters. A list that does not serve any more is replaced by a new one.

        ``positions`` are (N, m), and ``cell`` is (m, m), with a row for each axis, whether or not
        it is ``periodic`` (m,). A kept list gives the same numbers to the last digit as a new one.
        Raises :class:`~granphon.base.errors.InputError` for a period without length, and for
        periods that are not independent of each other.
        """
        if self._last_search is None or not self._last_search.serves(
            positions, cell, periodic, cutoff
        ):
            self._last_search = _search_pairs(positions, cell, periodic, cutoff + _SKIN)
        i, j, shift, _ = self._last_search.pairs
        vector = positions[j] - positions[i] + shift @ cell
        is_near = np.einsum("ca,ca->c", vector, vector) < cutoff**2
        return Pairs(*keep_rows(is_near, i, j, shift, vector))


class _ClosedContacts(NamedTuple):
    """Contacts that are closed at the positions of the balls; lengths are in diameters.

    Attributes
    ----------
    i, j : (n_c,) the balls of each contact.
    vector : (n_c, m) vector from ball i to ball j.
    normal : (n_c, m) direction of the contact of the lattice.
    along : (n_c, m) direction of the normal force on ball j.
    overlap : (n_c,) overlap of the two balls.
    """

    i: Index
    j: Index
    vector: Array
    normal: Array
    along: Array
    overlap: Array


class _ContactsAtRest(NamedTuple):
    """Contacts that are closed in the reference state; lengths are in diameters.

    Attributes
    ----------
    i, j : (n_c,) the balls of each contact.
    shift : (n_c, m) numbers of cells by which the image of ball j is shifted.
    vector : (n_c, m) from the site of ball i to that of ball j.
    axis : (n_c, m) direction of the contact.
    overlap, distance : (n_c,) the overlap, and the distance of the centres.
    """

    i: Index
    j: Index
    shift: Index
    vector: Array
    axis: Array
    overlap: Array
    distance: Array


class HertzMindlin(ContactCalculator):
    """ASE calculator of one-sided Hertz-Mindlin contacts, in the reduced units of its state.

    Energy, forces, torques and stress follow from positions and rotations. The energy of a contact
    is that of the state's contact law at the overlap of the contact, plus kappa s^2/2 + k_t
    twist^2/2 + k_b roll^2/2. Here s is the slip since the reference configuration, and twist and
    roll are the rotation of one ball relative to the other about the normal and across it. The
    stiffnesses are those of the reference configuration. Balls that are apart exert no force on
    each other. Stress, in Voigt order, is force over area; across a line or a plane of balls the
    cell counts as one diameter thick. Stress times ``Units.modulus`` is in Pa.

    The balls may be any cell of the lattice: a supercell, a slab (periodic in some directions
    only), a cluster, a cell with vacancies. If the motions of the state lead out of the plane,
    balls may stand out of the plane, and rotations and torques are (N, 3). Energy, forces and
    torques contain the contributions of all coordinates, even if the motions of the state are only
    those out of the plane.

    In the limit of small overlap (the default of a state) the overlap is delta - (r - d n).n with a
    fixed direction n. If the state has finite overlap, the overlap is ``d - |r|``. Slip is counted
    from the array ``slip_origin``.

    Force constants follow from the state and from the arrays ``displacements`` and
    ``diameter_deviations``; positions only tell which balls touch.

    The state of one simulated sample serves two kinds of Atoms: the sample's own
    ``sample.atoms()``, whose contacts have the law of two balls, and ``gp.atoms(state)``, whose
    contacts have the mean law.

    For any other Atoms, in m, ``HertzMindlin({"A": ball, "B": ball})`` returns the calculator
    :class:`~granphon.BallContacts`.

    Parameters
    ----------
    state : the state of the contacts, at one load; or a mapping of kinds to balls.

    Raises
    ------
    InputError : unknown keywords, or a state with several loads. When used: Atoms that lack masses
        or an array that :func:`~granphon.atoms` gives (:meth:`adopt` adds what is missing), or that
        belong to another state; numbers that are not finite, and diameters that are not above zero;
        a cell that is tilted out of the line or plane of the lattice, or periodic across it; balls
        that touch in directions other than those of the lattice, as when it is turned (allowed with
        ``finite_overlap`` where balls do not rotate); two balls at one place.
    PrecisionError : when used, if delta/d < 1e-10: positions hold too few digits of the overlap.
    """

    follows = tuple(ARRAYS)

    def __new__(cls, state: Any = None, *arguments: Any, **options: Any) -> Any:
        """Return a :class:`BallContacts` of ``state`` and the other arguments if ``state`` is a
        mapping of kinds to balls, else a new calculator of this class.
        """
        if isinstance(state, Mapping):
            return BallContacts(state, *arguments, **options)
        return super().__new__(cls)

    def __init__(self, state: ContactState, **unknown: Any) -> None:
        """Keep the numbers of the ``state`` that energies need, in reduced units.

        Raises :class:`~granphon.base.errors.InputError` for what is no ContactState, and for a
        keyword that ASE does not take itself.
        """
        super().__init__(**unknown)
        state = given_state(state)
        self.state = state
        self.finite_overlap = state.finite_overlap
        self.scales: Units = state.scales
        packing = state.packing
        self._coordinates = count_coordinates(packing)
        self._periods = packing.structure.periods
        self._eta = float(packing.mindlin_ratio)
        self._torsion = float(state.torsion)
        self._bending = float(packing.bending)
        # all motions of the coordinates, without rotations that no contact resists
        all_motions = _MOTIONS[self._coordinates - 1]
        self._motions = select_motions(self._eta, self._torsion, self._bending, all_motions)
        self._overlap = float(state.relative_overlap)
        #: overlap, in diameters, at which contacts open; below zero where balls adhere
        self._least_overlap = state.law.least_overlap / self.scales.length
        self._spacing = 1.0 - self._overlap if self.finite_overlap else 1.0
        # with finite overlap a contact of balls that do not turn acts along the line between them,
        # whatever the lattice
        self._has_free_directions = self.finite_overlap and not self._motions.rotate
        self._pair_list = PairList()

    def set(self, **unknown: Any) -> dict[str, Any]:
        """Raise :class:`~granphon.base.errors.InputError` for any keyword: all that this calculator
        needs is in its state. Without keywords return an empty dictionary, as ASE expects.
        """
        if unknown:
            names = ", ".join(map(repr, unknown))
            raise InputError(
                f"HertzMindlin has no keyword {names}", mend="Make another one of another state"
            )
        return {}

    # -- ASE's protocol ----------------------------------------------------------------------------

    def check_state(self, atoms: Atoms, tol: float = 1e-15) -> list[str]:
        """Return the names of the properties of ``atoms`` that have changed since the last
        calculation: those that ASE knows, granphon's arrays, and "masses" if masses were set or
        removed.

        ``tol`` is the difference up to which ASE takes two numbers for equal.
        """
        changes: list[str] = super().check_state(atoms, tol=tol)
        if self.atoms is not None and has_masses(self.atoms) != has_masses(atoms):
            changes = [*changes, "masses"]
        return changes

    def adopt(self, atoms: Atoms, like: Atoms | None = None) -> Atoms:
        """Return a copy of Atoms from another program, with all arrays that balls of this state
        need, and with this calculator.

        The copy keeps what ``atoms`` has, including what was set by hand. Masses, scales and arrays
        of :func:`~granphon.atoms` that are missing are copied from the Atoms ``like``, ball by
        ball. Without ``like`` the balls are taken for balls of the state on the sites of its
        lattice, with masses (1 + deviation)^3. Positions and cell must be in units of the mean
        diameter.

        Raises :class:`~granphon.base.errors.InputError` for what are no Atoms, if ``like`` has
        another number of balls, and if the Atoms belong to another state.
        """
        require_instance("atoms", atoms, Atoms, "Give an ase.Atoms")
        if like is not None:
            require_instance("like", like, Atoms, "Give an ase.Atoms")
        kind = FINITE if self.finite_overlap else LATTICE
        balls = adopt(atoms, self.scales, kind, like, self._coordinates)
        find_kind(balls, self.scales, self.finite_overlap, self._coordinates)
        balls.calc = self
        return balls

    def calculate(
        self,
        atoms: Atoms | None = None,
        properties: Any = ("energy",),
        system_changes: Any = all_changes,
    ) -> None:
        """Set ``results``, a dictionary: the energy, k d^2, the forces (N, 3), k d, and the stress
        (6,), k/d, of the atoms; keep the torques for :meth:`get_torques`. Without the vectors of a
        cell there is no stress.

        ASE gives the names of the ``properties`` that it asks for, and of the ``system_changes``
        since the last call.

        Raises :class:`~granphon.base.errors.PrecisionError` if balls overlap so little that
        positions do not hold the digits, and :class:`~granphon.base.errors.InputError` for Atoms
        that are not balls of the state, and if ASE asks for a stress and there is none.
        """
        from granphon.contacts.placed import ContactForces  # bands do not need it

        super().calculate(atoms, properties, system_changes)
        balls: Atoms = self.atoms
        require_instance("atoms", balls, Atoms, "Give an ase.Atoms")
        volume = self._find_volume(balls)
        if volume == 0.0 and "stress" in properties:
            vectors = ("a vector along x", "two vectors in the plane", "three vectors")
            raise InputError(
                f"the cell has no {_EXTENTS[self._periods - 1]}",
                "Stress is force over area",
                f"Give the cell {vectors[self._periods - 1]}",
            )
        overlap = self._overlap - self._least_overlap
        if overlap < _LEAST_OVERLAP:
            raise PrecisionError(
                f"energy, forces and stress need positions, and balls overlap by {overlap:.3g} d",
                f"Below {_LEAST_OVERLAP:g} positions hold too few digits of that",
                "Use force constants, bands and velocities, which need none",
            )
        law = self._choose_law(balls)
        contacts = self._find_closed_contacts(balls, law)
        loads = ContactForces(contacts.i, contacts.j, contacts.vector, len(balls), self._motions)
        # the law takes overlaps in m
        d = self.scales.length
        k = self.scales.stiffness
        overlap_in_metres = contacts.overlap * d
        loads.press(law.force(overlap_in_metres) / (k * d), contacts.along)
        if self._motions.rotate:
            self._resist_slips(balls, law, contacts, loads)
        energy = float(np.sum(law.energy(overlap_in_metres))) / (k * d * d) + loads.energy
        forces, virial = loads.collect()
        self._torques: Array = np.zeros(balls.arrays["rotations"].shape)
        if self._motions.rotate:
            self._torques[...] = loads.torque.reshape(self._torques.shape)
        self.results = {"energy": energy, "free_energy": energy, "forces": forces}
        if volume > 0.0:
            # stress is dE/d(strain of positions and cell) over the volume
            self.results["stress"] = list_stress(-virial / volume)

    def _find_volume(self, balls: Atoms) -> float:
        """Return the volume of the cell of ``balls``, d^3, which is one diameter thick across the
        periods; zero for a cell without a length, area or volume.
        """
        p = self._periods
        return float(abs(np.linalg.det(np.asarray(balls.cell)[:p, :p])))

    def _find_closed_contacts(self, balls: Atoms, law: Law) -> _ClosedContacts:
        """Return the contacts that are closed under the ``law`` at the positions of ``balls``."""
        from granphon.contacts.placed import find_overlaps  # bands do not need it

        i, j, _, vector = self._find_pairs(balls, balls.positions[:, : self._coordinates])
        deviations = balls.arrays["diameter_deviations"]
        # the diameters add this much to the distance at which the balls touch
        added_reach = 0.5 * (deviations[i] + deviations[j])
        normal, is_near = self._find_normals(vector, added_reach)
        if self.finite_overlap:
            overlap, along = find_overlaps(vector, 1.0, added_reach)
        else:
            overlap, along = find_overlaps(vector, 1.0, self._overlap + added_reach, normal)
        is_closed = is_near & (overlap > law.least_overlap / self.scales.length)
        return _ClosedContacts(*keep_rows(is_closed, i, j, vector, normal, along, overlap))

    def _resist_slips(
        self, balls: Atoms, law: Law, contacts: _ClosedContacts, loads: ContactForces
    ) -> None:
        """Add to the ``loads``, in place, those by which the closed ``contacts`` of ``balls``
        resist slip, twist and roll. Slip is counted from the array ``slip_origin``, twist and roll
        from balls that are not turned.

        The stiffnesses are those of the reference state (:meth:`_find_rest`) under the ``law``:
        slip, twist and roll add to the energy of that state.
        """
        i = contacts.i
        j = contacts.j
        m = self._coordinates
        axis_at_rest, overlap_at_rest, _ = self._find_rest(balls, i, j, contacts.normal)
        origin = balls.arrays["slip_origin"][:, :m]
        displacement = contacts.vector - self._spacing * contacts.normal - (origin[j] - origin[i])
        angles = np.atleast_2d(balls.arrays["rotations"].T).T  # (N, axes), rad
        stiffness, torsion = self._find_springs(law, overlap_at_rest)
        deviations = balls.arrays["diameter_deviations"]
        rows = contact_rows(
            axis_at_rest,
            self._spacing * 0.5 * (1.0 + deviations[i]),
            self._spacing * 0.5 * (1.0 + deviations[j]),
            self._motions,
            elongation=0.0,
            slip=self._eta,
            twist=torsion,
            roll=self._bending,
        )
        for row in rows:
            loads.resist(row, row.stiffness * stiffness, displacement, angles)

    def get_torques(self, atoms: Atoms) -> Array:
        """Return the torques on the balls of ``atoms``, -dE/dphi, k d^2: (N,), about z, of balls
        that stay on a line or in a plane, else (N, 3). Errors are those of :meth:`calculate`.
        """
        self.get_property("energy", atoms)
        return self._torques.copy()

    # -- contacts ----------------------------------------------------------------------------------

    def _find_pairs(self, balls: Atoms, positions: Array) -> Pairs:
        """Return the pairs of balls at ``positions`` (N, m), d, that are near enough to touch, each
        pair once.
        """
        largest_deviation = float(np.max(balls.arrays["diameter_deviations"], initial=0.0))
        cutoff = 1.0 + largest_deviation + _CATCH
        m = self._coordinates
        p = self._periods
        cell = np.asarray(balls.cell)[:m, :m]
        if p < m:  # vectors of the cell across the periods do not matter
            cell = np.concatenate([cell[:p], np.eye(m)[p:]])
        return self._pair_list.near(positions, cell, tuple(balls.pbc[:m].tolist()), cutoff)

    @cached_property
    def _directions(self) -> Array:
        """(2 n_c, m) unit vectors of the contacts of the lattice, from ball i to ball j, then from
        ball j to ball i.
        """
        normal = self.state.packing.structure.contacts.normal
        directions = np.concatenate([normal, -normal])
        n_missing = self._coordinates - normal.shape[1]  # components across the lattice, zero
        return np.pad(directions, ((0, 0), (0, n_missing)))

    @cached_property
    def _midway(self) -> float:
        """Distance, d, below which a pair of balls counts as neighbours that touch: the mean of the
        distances of touching balls and of second neighbours. If second neighbours are farther than
        a search reaches, the reach takes the place of their distance.
        """
        structure = self.state.packing.structure
        reach = 1.0 + 2.0 * _CATCH
        cell = np.eye(3)
        positions = np.zeros((structure.n_balls, 3))
        cell[: self._periods, : structure.dimension] = structure.vectors
        positions[:, : structure.dimension] = structure.positions
        periodic = tuple(axis < self._periods for axis in range(3))
        pairs = PairList().near(positions, cell, periodic, reach)
        distance = np.linalg.norm(pairs.vector, axis=1)
        second_distance = np.min(distance, where=distance > 1.0 + TOUCH, initial=reach)
        return 0.5 * self._spacing * (1.0 + float(second_distance))

    def _find_normals(
        self, vector: Array, added_reach: Array, at_sites: bool = False
    ) -> tuple[Array, Flags]:
        """Return the direction (n, m) of that contact of the lattice that is nearest to each pair,
        and (n,) whether the pair is near enough to be that contact.

        With finite overlap and balls that do not turn, the direction is that of the pair itself,
        and the length of its vector alone decides: however deep balls overlap, they are near.

        ``vector`` (n, m), d, joins the balls of each pair. ``added_reach`` (n,), d, is what the
        diameters of the two balls add to the distance at which balls touch. With ``at_sites`` the
        vectors join the sites of the balls, and only tell which balls touch.

        Raises :class:`~granphon.base.errors.InputError` if balls touch in another direction, if the
        lattice is turned too far for contacts of fixed direction, or if two balls are at one place.
        """
        distance = np.linalg.norm(vector, axis=1)
        if self._has_free_directions:
            is_near = distance < (self._midway if at_sites else self._spacing + _CATCH)
            require_apart(distance)
            return vector / distance[:, None], is_near
        nearest = np.argmax(vector @ self._directions.T, axis=1)
        normal = self._directions[nearest]
        is_near = np.linalg.norm(vector - self._spacing * normal, axis=1) < _CATCH
        reach = self._spacing + self._overlap + added_reach - self._least_overlap
        is_touching = is_near & (np.einsum("ca,ca->c", vector, normal) < reach)
        turn = _find_turn(normal, vector, distance, is_touching)
        # a turn shortens the part of a vector along its normal, and so adds to the overlap
        added_overlap = 0.5 * turn**2
        largest_added_overlap = _TURN_PER_OVERLAP * (self._overlap - self._least_overlap)
        if at_sites:
            largest_added_overlap = _TURN_PER_SPACING
        if np.any(~is_near & (distance < reach)):
            raise _make_turn_error("balls touch in directions that are not those of the lattice")
        if added_overlap > largest_added_overlap:
            raise _make_turn_error(
                f"contacts are turned against the lattice of the state, by {np.degrees(turn):.3g}"
                " degrees on average"
            )
        return normal, is_near

    def _find_rest(
        self, balls: Atoms, i: Index, j: Index, normal: Array
    ) -> tuple[Array, Array, Array]:
        """Return the direction (n_c, m), the overlap (n_c,), d, and the distance of the centres
        (n_c,), d, of each contact of balls ``i`` and ``j`` (n_c,) in the reference state.

        In the reference state balls are displaced from their sites by the array ``displacements``;
        the sites are one spacing apart in the direction ``normal`` (n_c, m). In the limit of small
        overlap the contact keeps the direction of the sites.
        """
        deviations = balls.arrays["diameter_deviations"]
        displacement = balls.arrays["displacements"]
        overlap = self._overlap + 0.5 * (deviations[i] + deviations[j])
        distance = np.full(len(normal), self._spacing)
        if not np.any(displacement):
            return normal, overlap, distance
        from granphon.contacts.deformation import (  # bands do not need it
            measure_losses,
            measure_turned,
        )

        m = self._coordinates
        normal_in_space = np.zeros((len(normal), 3))
        normal_in_space[:, :m] = normal
        ends = (i, j, self._spacing * normal_in_space)
        no_strain = np.zeros((3, 3))
        if not self.finite_overlap:
            loss = np.empty(len(normal))  # of overlap, which the loop writes
            measure_losses(*ends, normal_in_space, displacement, no_strain, loss)
            return normal, overlap - loss, distance
        is_flat = np.zeros(len(normal), bool)
        turned = measure_turned(*ends, is_flat, displacement, no_strain)
        return turned.normal[:, :m], overlap - turned.loss, turned.distance

    def _choose_law(self, balls: Atoms) -> Law:
        """Return the contact law of these balls: that of two balls for the Atoms of a sample, else
        that of the state.

        Raises :class:`~granphon.base.errors.InputError` if the balls cannot belong to the state, if
        their arrays hold numbers that are not finite, and for a diameter that is not above zero.
        """
        require_instance("atoms", balls, Atoms, "Give an ase.Atoms")
        self._require_known_sample(balls)
        kind = find_kind(balls, self.scales, self.finite_overlap, self._coordinates)
        arrays = [balls.positions, np.asarray(balls.cell), *(balls.arrays[name] for name in ARRAYS)]
        are_finite = all(np.all(np.isfinite(array)) for array in arrays)
        if not are_finite:
            raise InputError(
                "the Atoms hold a number that is not finite, in positions, cell or an array that"
                " granphon added"
            )
        deviations = balls.arrays["diameter_deviations"]
        if np.any(deviations <= -1.0):
            raise InputError(
                f"a ball of the Atoms has the diameter {1.0 + float(np.min(deviations)):.3g}",
                "Diameters, 1 plus diameter_deviations, are above zero",
                "Set this array",
            )
        require_lying(balls, self._periods)
        if kind == SAMPLE:
            return self.state.packing.law
        # contacts open at an overlap below zero if the law is a mean over diameters, or if balls
        # adhere
        if self._least_overlap < 0.0 and np.any(deviations):
            raise InputError(
                f"the Atoms have diameters of their own, and the law of {self.state.medium!r} is"
                f" the mean over all",
                "Their spread would count twice",
                "Use a state of AveragedLattice, whose law is that of two balls, or the Atoms of"
                " a sample",
            )
        return self.state.law

    def _require_known_sample(self, balls: Atoms) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``balls`` are Atoms of a sample whose
        contacts this calculator does not know: a sample among several of the state, one that was
        loaded with friction, one with its exact geometry, and one whose cell has sheared.
        """
        samples = self.state.samples
        if not samples or not has_sampled(balls):
            return
        if len(samples) > 1:
            raise InputError(
                f"the Atoms are of one sample, and the state is the mean over {len(samples)}",
                "Each sample has an overlap and a stiffness of its own",
                "Simulate that sample alone: DirectSimulation(packing, shape, seed=sample.seed)",
            )
        if getattr(self.state, "work", None) is not None:
            fault = "was loaded with friction"
            remedy = "simulate without a history"
        elif samples[0].is_exact:
            fault = "has its exact geometry"
            remedy = 'simulate with geometry="lattice"'
        elif samples[0].equilibrium.strain is not None:
            fault = "has a cell that sheared"
            remedy = 'simulate with boundary="isotropic"'
        else:
            return
        raise InputError(
            f"the Atoms are of a sample that {fault}",
            "A calculator has neither a history, nor true directions, nor sheared cells",
            f"Use the network of the sample, as gp.Waves(state.sample) does, or {remedy}",
        )

    def _find_springs(self, law: Law, overlap: Array) -> tuple[Array, float | Array]:
        """Return the normal stiffness (n_c,), k, and the torsion over k d^2, a number or (n_c,), of
        contacts with an ``overlap`` (n_c,), d, under the ``law``.

        For the law of the state at its overlap, both are exactly those of the state.
        """
        stiffness = np.ones(overlap.shape)
        torsion = np.full(overlap.shape, self._torsion)
        packing = self.state.packing
        is_different = (overlap != self._overlap) | (law is not self.state.law)
        if not np.any(is_different):
            return stiffness, self._torsion
        # the law of a simulation solves an equilibrium for each overlap, so it is evaluated only
        # for contacts that differ from those of the state
        depth = overlap[is_different] * self.scales.length
        slopes = law.stiffness(depth)
        stiffness[is_different] = slopes / self.scales.stiffness
        if packing.torsion != MINDLIN:
            return stiffness, self._torsion
        torsion[is_different] = packing.find_torsion(law.force(depth), slopes)
        return stiffness, torsion

    def contact_lattice(self, atoms: Atoms, motions: str | None = None) -> ContactLattice:
        """Return the harmonic :class:`~granphon.ContactLattice` of ``atoms``, any cell of these
        balls, about the state.

        Its contacts are the closed contacts of the lattice between the balls of the cell. The
        overlap of a contact is the overlap of the state, plus the mean of the two
        ``diameter_deviations``, minus the change of the distance by the ``displacements``. With
        ``finite_overlap`` displacements also turn the contacts. Masses are those of the Atoms. The
        periods and the dimension are those of the lattice; the dimension is three if displacements
        turn contacts out of the plane. Shear, torsion and bending of each contact are in proportion
        to its normal stiffness. With ``torsion="mindlin"`` each contact has the torsion of a Hertz
        contact under its own force.

        ``motions`` names some of the motions of the state, "longitudinal", "in_plane",
        "out_of_plane" or "all", and the others are left out; by default the lattice has all motions
        of the state. Raises :class:`~granphon.base.errors.InputError` for a name of motions that
        the state does not have, and for Atoms that the class refuses.
        """
        lattice, _, _ = self._find_lattice(atoms, motions)
        return lattice

    def contact_network(self, atoms: Atoms, motions: str | None = None) -> ContactNetwork:
        """Return the balls and the closed contacts of ``atoms``, any cell of these balls, as a
        :class:`~granphon.networks.network.ContactNetwork`, in SI.

        The contacts are those of :meth:`contact_lattice`, with their forces, and the positions
        those of the Atoms. The network repeats along the periods of the Atoms. With
        ``finite_overlap`` it has prestress. ``motions`` and errors are those of
        :meth:`contact_lattice`.
        """
        lattice, law, overlap = self._find_lattice(atoms, motions)
        d = self.scales.length
        positions = np.zeros((len(atoms), 3))
        positions[:, : lattice.dimension] = d * atoms.positions[:, : lattice.dimension]
        force = np.full(overlap.shape, self.state.force)
        # only contacts that differ from those of the state are evaluated, as in _find_springs
        is_different = (overlap != self._overlap) | (law is not self.state.law)
        if np.any(is_different):
            force[is_different] = law.force(overlap[is_different] * d)
        return lattice.contact_network(
            self.scales,
            force / self.scales.force,
            0.5 * (1.0 + atoms.arrays["diameter_deviations"]),
            positions=positions,
            pbc=tuple(atoms.pbc.tolist()),
            prestress=self.finite_overlap,
            contact_model=ContactModel.of(self.state.packing),
        )

    def _find_lattice(self, atoms: Atoms, motions: str | None) -> tuple[ContactLattice, Law, Array]:
        """Return the lattice of the closed contacts of ``atoms`` in the reference state, with the
        ``motions`` of this name (None for all), and the law and the overlaps (n_c,), d, of these
        contacts.
        """
        chosen_motions = self._choose_motions(motions)
        law = self._choose_law(atoms)
        sites = self._find_sites(atoms)
        contacts = self._find_closed_at_rest(atoms, sites, law)
        # displacements may turn contacts out of the plane
        dimension = self.state.packing.structure.dimension
        leaves_plane = np.any(contacts.axis[:, dimension:])
        width = self._coordinates if leaves_plane else dimension
        prestress = np.zeros(len(contacts.i))
        if self.finite_overlap:
            d = self.scales.length
            k = self.scales.stiffness
            prestress = law.force(contacts.overlap * d) / (k * d) / contacts.distance
        diameters = 1.0 + atoms.arrays["diameter_deviations"]
        arms = 0.5 * self._spacing * diameters
        table = freeze_contacts(
            contacts.i,
            contacts.j,
            contacts.shift[:, : self._periods],
            contacts.axis[:, :width],
            contacts.vector[:, :width],
            arms[contacts.i],
            arms[contacts.j],
        )
        stiffness, torsion = self._find_springs(law, contacts.overlap)
        lattice = ContactLattice(
            np.asarray(atoms.cell)[: self._periods, :width],
            sites[:, :width],
            table,
            self._eta,
            stiffness=stiffness,
            prestress=prestress,
            masses=atoms.get_masses(),
            gyration=GYRATION * diameters,
            torsion=torsion,
            bending=self._bending,
            motions=chosen_motions,
        )
        return lattice, law, contacts.overlap

    def _find_sites(self, atoms: Atoms) -> Array:
        """Return the sites (N, m) of ``atoms``, d: their positions without their displacements."""
        m = self._coordinates
        return np.asarray(atoms.positions[:, :m] - atoms.arrays["displacements"][:, :m])

    def _find_closed_at_rest(self, atoms: Atoms, sites: Array, law: Law) -> _ContactsAtRest:
        """Return the contacts between the balls of ``atoms`` at their ``sites`` (N, m), d, that are
        closed in the reference state under the ``law``.
        """
        i, j, shift, vector = self._find_pairs(atoms, sites)
        deviations = atoms.arrays["diameter_deviations"]
        added_reach = 0.5 * (deviations[i] + deviations[j])
        normal, is_near = self._find_normals(vector, added_reach, at_sites=True)
        axis, overlap, distance = self._find_rest(atoms, i, j, normal)
        is_closed = is_near & (overlap > law.least_overlap / self.scales.length)
        rows = keep_rows(is_closed, i, j, shift, vector, axis, overlap, distance)
        return _ContactsAtRest(*rows)

    def _choose_motions(self, name: str | None) -> Motions:
        """Return the motions of this ``name``, or all motions of the state if it is None.

        Raises :class:`~granphon.base.errors.InputError` for motions that the state does not have.
        """
        packing = self.state.packing
        motions = allowed_motions(packing.structure.dimension)[packing.ball_motions.name]
        if name is None:
            return motions
        subsets = {}
        for candidate in (LONGITUDINAL, IN_PLANE, OUT_OF_PLANE, ALL):
            has_translations = set(candidate.translations) <= set(motions.translations)
            has_rotations = set(candidate.rotations) <= set(motions.rotations)
            if has_translations and has_rotations:
                subsets[candidate.name] = candidate
        if not is_one_of(name, subsets):
            raise InputError(
                f"the state has no motions {brief(name)}",
                f"Its balls have the motions {motions.name!r}",
                f"Use {', '.join(subsets)}, or make a state of a Packing with these motions",
            )
        return subsets[name]

    @overload
    def get_force_constants(
        self, atoms: Atoms, format: Literal["dense"] = "dense", motions: str | None = None
    ) -> Array: ...

    @overload
    def get_force_constants(
        self, atoms: Atoms, format: Literal["csr"], motions: str | None = None
    ) -> csr_array[Any]: ...

    def get_force_constants(
        self, atoms: Atoms, format: Literal["dense", "csr"] = "dense", motions: str | None = None
    ) -> Array | csr_array[Any]:
        """Return the analytic force constants of the cell, each summed over the images of the
        balls, k.

        Parameters
        ----------
        atoms : any cell of these balls.
        format : "dense" for an array (N, N, m, m), "csr" for a (mN, mN) ``scipy.sparse.csr_array``.
            Another word raises :class:`~granphon.base.errors.InputError`, as does a dense array
            that does not fit into memory.
        motions : some of the motions of the state, see :meth:`contact_lattice`; by default all of
            them.

        Returns
        -------
        constants : the force constants between the m motions of all balls. The motions are (x, y,
            w) in the plane, (x, y, z, w_x, w_y, w_z) in space and in a plane with the motions
            "all", (z, w_x, w_y) out of the plane, (x,) along a chain. Rotations that no contact
            resists are left out, except that in the plane the rows and columns of w are then zero.

        Notes
        -----
        w = R_g phi is a length, so that the mass of the ball serves all coordinates. In a cell so
        small that two balls touch more than once (2 x 2 and less), contacts add up.
        """
        layout = one_of("format", format, ("dense", "csr"))
        lattice = self.contact_lattice(atoms, motions)
        n = lattice.n_balls
        blocks = contact_blocks(lattice)
        # `size` is the number of coordinates of a ball in the blocks; `slots` are those returned
        size = blocks.shape[1] // 2
        all_slots = list(range(size))
        slots = list(lattice.motions.slots)
        if lattice.motions.name == IN_PLANE.name:
            slots = all_slots
        row, column = _list_places(lattice, size)
        shape = (size * n, size * n)
        if layout == "csr":
            from scipy.sparse import coo_array

            sparse: csr_array[Any] = coo_array((blocks.ravel(), (row, column)), shape=shape).tocsr()
            sparse.sum_duplicates()
            if slots != all_slots:
                chosen = (size * np.arange(n)[:, None] + slots).ravel()
                sparse = sparse[chosen][:, chosen]
            return sparse
        require_memory(
            f"dense force constants of {n:,} balls",
            16.0 * (size * n) ** 2,
            'Take fewer balls, or format="csr"',
        )
        dense = np.zeros(shape)
        np.add.at(dense, (row, column), blocks.ravel())
        by_ball = dense.reshape(n, size, n, size).transpose(0, 2, 1, 3)
        return by_ball[:, :, slots][..., slots]


def _list_places(lattice: ContactLattice, size: int) -> tuple[Index, Index]:
    """Return the rows and columns (n_c 4 size^2,), in the force constants of all balls of a
    ``lattice``, of the entries of :func:`contact_blocks`, which has ``size`` coordinates of each
    ball.
    """
    table = lattice.contacts
    balls = np.stack([table.i, table.j], axis=1)
    # the coordinates of both balls of each contact
    coordinates = (size * balls[:, :, None] + np.arange(size)).reshape(len(table), 2 * size)
    shape = (len(table), 2 * size, 2 * size)
    row = np.broadcast_to(coordinates[:, :, None], shape).ravel()
    column = np.broadcast_to(coordinates[:, None, :], shape).ravel()
    return row, column


def _make_turn_error(fault: str) -> InputError:
    """Return the error of balls whose contacts do not have the directions of the lattice, with the
    problem ``fault``.
    """
    return InputError(
        fault,
        "With friction, and in the limit of small overlap, contacts keep the directions of the"
        " lattice: balls are turned against the lattice, or were moved",
        "Keep the orientation of gp.atoms(state), or take a state of finite overlap without"
        " friction",
    )


def _find_turn(normal: Array, vector: Array, distance: Array, is_touching: Flags) -> float:
    """Return the angle, rad, by which pairs of balls are turned on average against the directions
    ``normal`` (n, m) of their contacts; in the plane with its sign.

    The mean is over the pairs for which ``is_touching`` (n,) is true; the angle is zero without
    such a pair, and for balls on a line. ``vector`` (n, m), in diameters, joins the balls of each
    pair, and ``distance`` (n,) is its length.
    """
    m = normal.shape[1]
    if m == 1 or not np.any(is_touching):
        return 0.0
    normal, vector, distance = keep_rows(is_touching, normal, vector, distance)
    if m == 2:
        across = normal[:, 0] * vector[:, 1] - normal[:, 1] * vector[:, 0]
        return float(np.mean(across / distance))
    # for a rotation by omega, n x v is (1 - nn) omega times the length of v; omega is found by
    # least squares over all contacts. Contacts along a single line show no rotation about that
    # line, so the inverse is a pseudoinverse
    total = np.sum(np.cross(normal, vector) / distance[:, None], axis=0)
    projection = len(normal) * np.eye(3) - normal.T @ normal
    turn = np.linalg.pinv(projection, rcond=_NO_ROTATION, hermitian=True) @ total
    return float(np.linalg.norm(turn))


def _list_springs(lattice: ContactLattice) -> list[tuple[Row, Array]]:
    """Return the rows of the deformations of contacts of a ``lattice``, each with its stiffness
    (n_c,), k, followed by those on which static forces act.
    """
    springs = [(row, row.stiffness * lattice.stiffness) for row in lattice.rows]
    return springs + lattice.static_rows if lattice.is_prestressed else springs


def contact_blocks(lattice: ContactLattice) -> Array:
    """Return the force constants (n_c, 6, 6), k, of each contact of a ``lattice`` alone, between
    the three coordinates of ball i followed by the three of ball j.

    The coordinates are (x, y, w) in the plane, (w_x, w_y, z) out of the plane, and (x, y, z) if
    balls move in space and do not turn. Force constants of coordinates without a motion are zero.
    If balls have all six motions, the shape is (n_c, 12, 12), for (x, y, z, w_x, w_y, w_z) of each
    ball.
    """
    slots = list(lattice.motions.slots)
    count = 3 * lattice.motions.atoms_per_ball
    springs = _list_springs(lattice)
    entries = np.zeros((len(springs), 2 * count, len(lattice.contacts)))
    for entry, (row, _) in zip(entries, springs, strict=True):
        # a deformation is head.x_j - tail.x_i
        entry[:count][slots] = -row.tail.T
        entry[count:][slots] = row.head.T
    stiffnesses = [stiffness for _, stiffness in springs]
    # of each contact c, for coordinates a and b, the sum over the rows r
    return np.asarray(np.einsum("rc,rac,rbc->cab", stiffnesses, entries, entries))
