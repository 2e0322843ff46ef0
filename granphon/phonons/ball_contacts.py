"""The ASE calculator of any balls in contact, in SI, and what ASE finds by granphon's entry points.

Balls are Atoms whose lengths are in m. Each has a radius and a kind. Their positions tell which
balls touch, and how far they overlap, and the contact law of the two balls gives the force. ASE
reads tables and dumps of networks by the formats ``granphon-tables`` and ``granphon-lammps``, and
finds the calculators as plug-ins.

E* and G* are the moduli of a contact along its normal and across it
(:class:`~granphon.balls.ball.ContactConstants`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
from ase import Atoms
from ase.calculators.calculator import Calculator, all_changes
from ase.utils.plugins import ExternalIOFormat

from granphon.balls.ball import Ball, ContactConstants
from granphon.balls.contact_laws import (
    Hertz,
    PairLaw,
    check_law,
    law_of_pair,
    opening_overlap,
    read_laws,
)
from granphon.balls.contact_model import ContactModel
from granphon.balls.material import Material
from granphon.balls.motions import ALL, select_motions
from granphon.balls.neighbours import find_pairs
from granphon.base.arrays import Array, Index
from granphon.base.errors import InconsistencyWarning, InputError, brief, warn_caller
from granphon.base.text import list_names, require_path
from granphon.base.validation import finite_array, require, require_instance, spell_out, truth
from granphon.contacts.laws import ContactLaws
from granphon.networks.network import ContactNetwork
from granphon.networks.sources import Completion, CompletionOptions
from granphon.networks.tables import read_tables
from granphon.phonons.phonopy_atoms import choose_symbols

#: distance of balls over their diameter, or diameter over distance, above which their positions
#: seem to be in another unit, such as mm or cm
_UNIT_RATIO = 50.0
#: length, area or volume of a cell, in units of the diameter, below which it counts as zero
LEAST_EXTENT = 1e-12
#: relative amount by which the reach of balls is enlarged, so that rounding opens no contact
_ROUNDING = 1e-12
#: motions of balls whose rotations nothing resists
_ROLLING_FREELY = select_motions(0.0, among=ALL)
#: rows and columns of the entries of a (3, 3) matrix in Voigt order: xx, yy, zz, yz, xz, xy
_VOIGT = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])


def list_stress(stress: Array) -> Array:
    """Return the symmetric part of a ``stress`` (3, 3) in Voigt order, (6,)."""
    return np.asarray((0.5 * (stress + stress.T))[_VOIGT])


class ContactCalculator(Calculator):  # type: ignore[misc]
    """Base of the calculators of contacts: the properties that they compute, and when ASE computes
    them anew.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]
    discard_results_on_any_change = True
    #: arrays of the Atoms on which results depend, besides those that ASE knows
    follows: tuple[str, ...] = ()

    def check_state(self, atoms: Atoms, tol: float = 1e-15) -> list[str]:
        """Return the names of the properties of ``atoms`` that have changed since the last
        calculation, with those of the arrays that the calculator ``follows``.

        ``tol`` is the difference up to which ASE takes two numbers for equal. Raises
        :class:`~granphon.base.errors.InputError` for what are no Atoms.
        """
        require_instance("atoms", atoms, Atoms, "Give an ase.Atoms")
        changes: list[str] = super().check_state(atoms, tol=tol)
        if self.atoms is None:
            return changes
        old = self.atoms.arrays
        new = atoms.arrays
        for name in self.follows:
            if not np.array_equal(old.get(name), new.get(name)):
                changes.append(name)
        return changes


class FoundContacts(NamedTuple):
    """The n_c contacts of the balls of Atoms, each once.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two balls.
    shift : (n_c, 3) numbers of periods by which the image of ball j is shifted.
    vector : (n_c, 3) from the centre of ball i to that of the image of ball j, m.
    laws : the contact laws.
    ratio : (n_c,) 4 G*/E* of each contact.
    """

    i: Index
    j: Index
    shift: Index
    vector: Array
    laws: ContactLaws
    ratio: Array


class BallContacts(ContactCalculator):
    """ASE calculator of any balls, in SI: Atoms in m, energy in J, forces in N, stress in Pa.

    The energy of a contact is that of the law of its two balls at their overlap, the sum of the
    radii less the distance of the centres. The forces are those along the lines of centres, by
    which balls come to rest; balls roll and slide freely. The network that
    :meth:`contact_network` returns has the shear stiffness of Mindlin as well. Stress is that over
    the volume of the cell of the Atoms; there is none if the volume is zero.

    :class:`~granphon.HertzMindlin` of a mapping of kinds returns such a calculator. ASE's
    optimisers move balls by the forces over ``alpha``, by no more than ``maxstep``, and stop when
    forces are below ``fmax``. Give them a stiffness (N/m), a part of the overlap (m) and a part of
    the force of a contact (N).

    Parameters
    ----------
    balls : a :class:`~granphon.Ball` or :class:`~granphon.Material` for each kind. The kind of each
        of the Atoms is in their array ``kinds``, or else their chemical symbol; its radius is in
        the array ``radius``, m, or else that of the ball.
    law : the contact law of all pairs, Hertz's by default, or one for each pair of kinds, as for a
        :class:`~granphon.Crystal`.
    friction : whether contacts of a network resist slip.

    Raises
    ------
    InputError : ``balls`` is no mapping to balls or materials, or is empty; ``law`` is the name of
        no law, or has a key that is no pair of kinds, or two laws of one pair; ``friction`` is not
        true or false. When the calculator is used: what are no Atoms; a pair of kinds without a
        law, or whose law lacks a method of contact laws; Atoms of another kind, without radii, or
        with radii that are not above zero; positions or a cell that are not finite; two balls at
        one place; a period of the cell far below the diameters, perhaps in another unit, and
        periods that are not independent; a law of a bond, which acts at any distance, so that there
        are no neighbours.
    """

    follows = ("radius", "kinds")

    def __init__(
        self, balls: Mapping[str, Ball | Material], law: Any = None, friction: bool = True
    ) -> None:
        """Check the arguments; laws of pairs are found when they are needed."""
        super().__init__()
        any_balls: Any = balls
        are_balls = isinstance(any_balls, Mapping) and all(
            isinstance(ball, Ball | Material) for ball in any_balls.values()
        )
        if not are_balls or not any_balls:
            raise InputError(
                f"the balls are {brief(any_balls)}",
                mend='Give a granphon.Ball or Material for each kind, as {"Na": ball}',
            )
        self.balls = dict(balls)
        self.friction = require("friction", truth, friction)
        self._law = read_laws(law)
        self._laws = dict[tuple[str, float, str, float], tuple[PairLaw, float, float]]()

    def find_radii(self, atoms: Atoms) -> tuple[list[str], Array]:
        """Return the kinds (n,) of the balls of ``atoms``, and their radii (n,), m.

        Raises :class:`~granphon.base.errors.InputError` for what are no Atoms, for a kind without a
        ball, for materials without an array ``radius``, for such an array that is not a number
        above zero for each ball, and for positions or a cell that are not finite.
        """
        require_instance("atoms", atoms, Atoms, "Give an ase.Atoms")
        kinds = [str(kind) for kind in atoms.arrays.get("kinds", atoms.get_chemical_symbols())]
        missing = sorted(set(kinds) - set(self.balls))
        if missing:
            raise InputError(
                f"there is no ball for the kind {list_names(missing)}",
                mend="Give one for each kind in the array 'kinds', or each symbol",
            )
        radii = atoms.arrays.get("radius")
        if radii is None:
            balls = [self.balls[kind] for kind in kinds]
            radii = np.array([ball.radius for ball in balls if isinstance(ball, Ball)])
            if len(radii) < len(balls):
                raise InputError(
                    "the Atoms have no array 'radius', and the kinds are materials",
                    mend="Set the radii, m, or give a granphon.Ball for each kind",
                )
        if len(kinds):
            radii = finite_array("the array radius", radii, low="above zero")
        if np.shape(radii) != (len(kinds),):
            raise InputError(
                f"the array radius has the shape {np.shape(radii)}",
                mend="Give one number for each ball, m",
            )
        if not (np.all(np.isfinite(atoms.positions)) and np.all(np.isfinite(atoms.cell.array))):
            raise InputError(
                "the Atoms have a position or a cell that is not finite",
                mend="Mend their positions and cell",
            )
        return kinds, np.asarray(radii, float)

    def _find_law(
        self, kind_i: str, radius_i: float, kind_j: str, radius_j: float
    ) -> tuple[PairLaw, float, float]:
        """Return the contact law of a ball i of ``kind_i`` and ``radius_i``, m, and a ball j of
        ``kind_j`` and ``radius_j``, and 4 G*/E* and E*, Pa, of their contact; each pair is computed
        and checked once, and then kept.
        """
        key = (kind_i, radius_i, kind_j, radius_j)
        if key not in self._laws:
            ball_i = self._make_ball(kind_i, radius_i)
            ball_j = self._make_ball(kind_j, radius_j)
            law = law_of_pair(self._law, ball_i, ball_j, kind_i, kind_j)
            constants = ContactConstants.of(ball_i, ball_j)
            check_law(law, constants.radius)
            self._laws[key] = (law, constants.mindlin_ratio, constants.modulus)
        return self._laws[key]

    def _make_ball(self, kind: str, radius: float) -> Ball:
        """Return a ball of the material of a ``kind``, with a ``radius``, m."""
        ball = self.balls[kind]
        material = ball if isinstance(ball, Material) else ball.material
        return Ball(material, 2.0 * radius, name=kind)

    def find_contacts(self, atoms: Atoms) -> FoundContacts:
        """Return the contacts of the balls of ``atoms``: balls that overlap, or are so near that
        adhesion may still hold them.

        Warns with :class:`~granphon.base.errors.InconsistencyWarning` if the positions seem to be
        in another unit than m. Raises :class:`~granphon.base.errors.InputError` as the class says.
        """
        kinds, radii = self.find_radii(atoms)
        keys = list(zip(kinds, radii.tolist(), strict=True))
        sorts = list(dict.fromkeys(keys))  # different pairs of kind and radius, in order
        number_of_sort = {sort: number for number, sort in enumerate(sorts)}
        number = np.array([number_of_sort[key] for key in keys], np.intp)
        reach = (radii + 0.5 * self._find_gap(sorts)) * (1.0 + _ROUNDING)
        periods = np.flatnonzero(atoms.pbc)
        longest = 2.0 * float(np.max(reach, initial=0.0))
        shortest = float(np.min(np.linalg.norm(atoms.cell.array[periods], axis=1), initial=np.inf))
        if longest > _UNIT_RATIO * shortest:  # each ball would touch thousands of its own images
            raise InputError(
                f"balls are up to {longest:.3g} m wide, and a period of the cell is"
                f" {shortest:.3g} m",
                mend="Give the cell, the positions and the radii in m",
            )
        if longest > 0.0:
            require_independent(atoms.cell.array[periods] / longest)
        i, j, steps, vector = find_pairs(atoms.positions, atoms.cell.array[periods], longest)
        distance = np.linalg.norm(vector, axis=1)
        require_apart(distance)
        is_touching = distance < reach[i] + reach[j]
        if not np.any(is_touching):
            _warn_of_far_balls(atoms, radii, shortest)
        elif float(np.max(distance)) * _UNIT_RATIO < 2.0 * float(np.min(radii)):
            _warn_of_lengths(f"or less, and {2.0 * np.min(radii):.3g} m wide", np.max(distance))
        i = i[is_touching]
        j = j[is_touching]
        vector = vector[is_touching]
        shift = np.zeros((len(i), 3), np.intp)
        shift[:, periods] = steps[is_touching]
        laws, ratio = self._find_laws(sorts, number[i], number[j])
        return FoundContacts(i, j, shift, vector, laws, ratio)

    def _find_laws(
        self, sorts: list[tuple[str, float]], sort_i: Index, sort_j: Index
    ) -> tuple[ContactLaws, Array]:
        """Return the laws of n_c contacts, and 4 G*/E* (n_c,) of each.

        ``sorts`` are the sorts of balls, each a kind and a radius, m; ``sort_i`` and ``sort_j``
        (n_c,) are the numbers of the sorts of the two balls of each contact.
        """
        count = len(sort_i)
        groups = list[tuple[PairLaw, Index]]()
        ratio = np.empty(count)
        modulus = np.empty(count)
        # contacts of the same two sorts of balls have one law
        lower = np.minimum(sort_i, sort_j)
        upper = np.maximum(sort_i, sort_j)
        for contacts in _group_equal(lower * len(sorts) + upper):
            first = contacts[0]
            kind_i, radius_i = sorts[sort_i[first]]
            kind_j, radius_j = sorts[sort_j[first]]
            law, mindlin_ratio, pair_modulus = self._find_law(kind_i, radius_i, kind_j, radius_j)
            ratio[contacts] = mindlin_ratio
            modulus[contacts] = pair_modulus
            groups.append((law, contacts))
        return ContactLaws(groups, count, modulus), ratio

    def _find_gap(self, sorts: list[tuple[str, float]]) -> float:
        """Return the largest distance, m, between the surfaces of two balls at which adhesion still
        holds them together; zero without adhesion.

        ``sorts`` are the sorts of balls, each a kind and a radius, m. Raises
        :class:`~granphon.base.errors.InputError` for the law of a bond, which acts at any distance.
        """
        gap = 0.0
        if not isinstance(self._law, Hertz):  # Hertz's law has no adhesion
            overlaps = [0.0]
            for sort_i, sort_j in itertools.product(sorts, repeat=2):
                law, _, _ = self._find_law(*sort_i, *sort_j)
                overlaps.append(opening_overlap(law))
            gap = -min(overlaps)
        if math.isinf(gap):
            raise InputError(
                "a bond has no end, and so no neighbours", mend="Give a law with a least_overlap"
            )
        return gap

    def calculate(
        self,
        atoms: Atoms | None = None,
        properties: Any = ("energy",),
        system_changes: Any = all_changes,
    ) -> None:
        """Set ``results``, a dictionary: the energy, J, the forces (n, 3), N, and the stress (6,),
        Pa, of the atoms.

        ASE gives the names of the ``properties`` that it asks for, and of the ``system_changes``
        since the last call. Raises :class:`~granphon.base.errors.InputError` as the class says, and
        if ASE asks for the stress and the cell has no volume.
        """
        from granphon.contacts.placed import ContactForces, find_overlaps  # bands do not need it

        super().calculate(atoms, properties, system_changes)
        balls = self.atoms
        _, radii = self.find_radii(balls)
        found = self.find_contacts(balls)
        overlap, normal = find_overlaps(found.vector, radii[found.i] + radii[found.j], 0.0)
        contacts = ContactForces(found.i, found.j, found.vector, len(balls), _ROLLING_FREELY)
        contacts.press(found.laws.force(overlap), normal)
        forces, virial = contacts.collect()
        energy = math.fsum(found.laws.energy(overlap))
        volume = abs(float(np.linalg.det(balls.cell.array)))
        self.results = {"energy": energy, "free_energy": energy, "forces": forces}
        if volume > 0.0:
            self.results["stress"] = list_stress(-virial / volume)
        elif "stress" in properties:
            raise InputError(
                "the cell has no volume", "Stress is force over area", "Give it three vectors"
            )

    @spell_out(Completion)
    def contact_network(self, atoms: Atoms, **options: Unpack[CompletionOptions]) -> ContactNetwork:
        """Return the balls of ``atoms`` and their contacts as a network, in SI, with Mindlin's
        shear stiffness, or none if the calculator is without friction.

        The ``options`` are those of :meth:`ContactNetwork.from_table`. The masses are those of the
        balls that the calculator was given, or of solid balls of their materials where only these
        were given, or the radius is another; those of Atoms are atomic, and are not read. The
        network repeats where the Atoms do; without a period it has no cell. Raises
        :class:`~granphon.base.errors.InputError` as the class says, for Atoms without balls, and
        as :meth:`ContactNetwork.from_table` does.
        """
        from granphon.contacts.placed import find_overlaps  # bands do not need it

        kinds, radii = self.find_radii(atoms)
        found = self.find_contacts(atoms)
        overlap, _ = find_overlaps(found.vector, radii[found.i] + radii[found.j], 0.0)
        x, y, z = atoms.positions.T
        masses = [self._find_mass(*sort) for sort in zip(kinds, radii.tolist(), strict=True)]
        balls = {"x": x, "y": y, "z": z, "radius": radii, "mass": masses, "kind": kinds}
        contacts = {
            "i": found.i,
            "j": found.j,
            "normal_force": found.laws.force(overlap),
            "normal_stiffness": found.laws.stiffness(overlap),
            "shear_stiffness": found.ratio * found.laws.punch(overlap) * self.friction,
            "shift_1": found.shift[:, 0],
            "shift_2": found.shift[:, 1],
            "shift_3": found.shift[:, 2],
        }
        # the model of the contacts has one ball for each kind, here one of mean radius
        names = tuple(dict.fromkeys(kinds))
        mean_balls = []
        for name in names:
            mean_radius = float(np.mean(radii[np.array(kinds) == name]))
            mean_balls.append(self._make_ball(name, mean_radius))
        model = ContactModel(tuple(mean_balls), names, self._law, self.friction, own_radii=True)
        is_periodic = bool(np.any(atoms.pbc))
        cell = atoms.cell.array if is_periodic else None
        pbc = atoms.pbc.tolist() if is_periodic else None
        source = replace(read_tables(balls, contacts, {}, cell, pbc), contact_model=model)
        return ContactNetwork.from_source(source, Completion(**options))

    def _find_mass(self, kind: str, radius: float) -> float:
        """Return the mass, kg, of a ball of a ``kind`` with a ``radius``, m.

        If the ball that the calculator was given for the kind has this radius, the mass is that of
        the ball, which may differ from that of its material and volume.
        """
        ball = self.balls[kind]
        if not isinstance(ball, Ball) or ball.radius != radius:
            ball = self._make_ball(kind, radius)
        return ball.mass


def require_apart(distance: Array) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the ``distance`` (n,) of the centres of
    some of n pairs of balls is zero.
    """
    if not np.all(distance):
        raise InputError(
            "two balls are at one place", "The force between them has no direction", "Move one"
        )


def require_independent(periods: Array) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if one of the ``periods`` (p, m), in
    diameters, has zero length, or if they are not independent of each other.
    """
    if not np.all(np.any(periods, axis=1)):
        raise InputError(
            "the balls are periodic along a cell vector of zero length", "The period is not known"
        )
    # the product of the singular values is the length, area or volume; 1 without periods
    p = len(periods)
    extent = np.prod(np.linalg.svd(periods, compute_uv=False)) if p else 1.0
    if extent < LEAST_EXTENT:
        measure = ("a length", "an area", "a volume")[p - 1]
        raise InputError(
            f"the balls are periodic in a cell without {measure}",
            f"Its vectors are {'parallel' if p == 2 else 'not independent'}",
        )


def _group_equal(numbers: Index) -> list[Index]:
    """Return groups of the indices of ``numbers`` (n,); the numbers of a group are equal."""
    order = np.argsort(numbers, kind="stable")
    if not order.size:
        return []
    return np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1)


def _warn_of_far_balls(atoms: Atoms, radii: Array, shortest: float) -> None:
    """Warn with :class:`~granphon.base.errors.InconsistencyWarning` if the balls of ``atoms``, none
    of which touch, with ``radii`` (n,), m, are so far from each other that their positions seem not
    to be in m. ``shortest`` is the shortest period, m, the distance of a ball from its own image.
    """
    # imported here, because the import loads much of scipy, and is hardly ever needed
    from scipy.spatial import cKDTree

    # the second nearest ball, as the nearest is the ball itself; infinite for a single ball
    distances, _ = cKDTree(atoms.positions).query(atoms.positions, k=[2])
    nearest = min(float(np.min(distances, initial=np.inf)), shortest)
    diameter = 2.0 * float(np.max(radii, initial=0.0))
    if math.isfinite(nearest) and nearest > _UNIT_RATIO * diameter:
        _warn_of_lengths(f"or more, and {diameter:.3g} m wide: none touch", nearest)


def _warn_of_lengths(words: str, distance: float) -> None:
    """Warn with :class:`~granphon.base.errors.InconsistencyWarning` of balls that are a
    ``distance``, m, from each other; the ``words`` continue the sentence, and say how wide the
    balls are.
    """
    text = f"the balls are {distance:.3g} m from each other {words}. Their positions are to be in m"
    warn_caller(text, InconsistencyWarning)


# -- what ASE finds by entry points ----------------------------------------------------------------

#: formats of :func:`ase.io.read`; tables that granphon has written are recognised by their first
#: comment
tables_format = ExternalIOFormat(
    "granphon: table of balls, beside one of their contacts",
    "1S",
    __name__,
    glob="*balls.csv",
    magic_regex=rb".{0,200}# granphon network: ",
)
lammps_format = ExternalIOFormat(
    "granphon: LAMMPS dump of balls, beside one of the pairs that touch", "1S", __name__
)


def _make_atoms(network: ContactNetwork) -> Atoms:
    """Return the balls of a ``network`` as Atoms in its reduced units, with the arrays ``radius``,
    ``kinds`` and ``rattler`` (whether a ball carries no load); ``info`` holds the units.

    Balls that are held are Atoms of infinite mass. A flat wall, whose radius is infinite, is left
    out.
    """
    scales = network.scales
    has_size = np.isfinite(network.radii)
    kinds = np.array(network.kinds or ["X"] * len(has_size))[has_size]
    symbols = choose_symbols(kinds.tolist()) if network.kinds else {"X": "X"}
    balls = Atoms(
        [symbols[kind] for kind in kinds.tolist()],
        positions=network.positions[has_size] / scales.length,
        cell=network.cell / scales.length,
        pbc=network.pbc,
        masses=network.masses[has_size] / scales.mass,
    )
    balls.set_array("radius", network.radii[has_size] / scales.length)
    balls.set_array("kinds", kinds)
    balls.set_array("rattler", np.isin(np.arange(network.n_balls), network.rattlers)[has_size])
    balls.info.update(scales.to_info())
    return balls


def _find_beside(path: Any, contacts: Any, word: str, replacement: str) -> Any:
    """Return the file of ``contacts``, if one is given; else the path of the file beside that of
    the balls, ``path``, in whose name ``replacement`` stands for ``word``.

    Raises :class:`~granphon.base.errors.InputError` if ``path`` is no path, or its name lacks the
    word.
    """
    if contacts is not None:
        return contacts
    require_path(path)
    balls = Path(path)
    if word not in balls.name:
        raise InputError(
            f"{path} has its contacts in another file",
            mend=f"Name that file too, or call the file of balls ...{word}...",
        )
    return balls.with_name(balls.name.replace(word, replacement))


def read_granphon_tables(path: Any, contacts: Any = None, **options: Any) -> Atoms:
    """Return the balls of the table ``path``, with the table of their ``contacts``, as Atoms in the
    reduced units of their network, for :mod:`ase.io`.

    By default the table of contacts lies beside that of balls, with "contacts" instead of "balls"
    in its name. ``options`` are those of :meth:`ContactNetwork.from_table`, which also says what is
    raised; by default rattlers are kept.
    """
    contacts_file = _find_beside(path, contacts, "balls", "contacts")
    options = {"keep_rattlers": True} | options
    return _make_atoms(ContactNetwork.from_table(path, contacts_file, **options))


def read_granphon_lammps(path: Any, pairs: Any = None, **options: Any) -> Atoms:
    """Return the balls of the dump ``path``, with the dump of the ``pairs`` that touch, as Atoms in
    the reduced units of their network, for :mod:`ase.io`.

    By default the dump of pairs lies beside that of atoms, with "pairs" instead of "atoms" in its
    name. ``options`` are those of :meth:`ContactNetwork.from_lammps`, which also says what is
    raised; by default rattlers are kept. With neither a ``material`` nor a ``normal_stiffness``,
    all normal stiffnesses are 1 N/m, and shear stiffnesses are zero unless they are given.
    """
    has_stiffness = "material" in options or "normal_stiffness" in options
    if not has_stiffness:
        options = {"normal_stiffness": 1.0, "shear_stiffness": 0.0} | options
    pairs_file = _find_beside(path, pairs, "atoms", "pairs")
    options = {"keep_rattlers": True} | options
    return _make_atoms(ContactNetwork.from_lammps(path, pairs_file, **options))


def __getattr__(name: str) -> Any:
    """Return the attribute ``__ase_plugins__`` of this module, the calculators that ASE lists, made
    on demand; an empty set for an ASE without plug-ins. Any other ``name`` raises AttributeError.
    """
    if name != "__ase_plugins__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # modules that hold the class of plug-ins in ASE's releases
    for module in ("ase.plugins", "ase._4.plugins.plugin"):
        with suppress(ImportError, AttributeError):
            plugin_type = import_module(module).CalculatorPlugin
            plugin = plugin_type(
                "hertz-mindlin",
                citation="B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002)",
                implementation="granphon.phonons.calculator.HertzMindlin",
            )
            return {plugin}
    return set()
