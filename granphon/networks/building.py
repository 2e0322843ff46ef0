"""Networks of balls and contacts of which a program of discrete elements has left a part: the rest
follows from it.

Stiffnesses follow from force and material by Hertz and Mindlin, masses from the density, inertias
are those of solid spheres, shifts lead to the nearest image, and normals lie along the line of the
centres.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from granphon.balls.ball import BALL_LIMITS, WRONG_UNIT, Ball
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import HertzLaw, harmonic_diameter
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, brief, message
from granphon.base.text import counted
from granphon.base.validation import real_array, require, truth, whole_number

#: greatest number in SI, and the inverse of the least one: products of a few of them stay within
#: the range of floats
LARGEST = 1e60
#: greatest number of cells between two balls
MOST_STEPS = 1_000_000_000
#: greatest gap or overlap of two balls, over the sum of their radii, at which they may be in
#: contact
_REACH = 0.25
#: greatest error of a vector between two balls, over the sum of their radii, that is put down to
#: rounding in a file
_ROUNDED = 1e-2
#: difference of z, over the largest radius, up to which balls are in one plane: the rounding in a
#: file
_LEVEL = 1e-9
#: greatest factor between a force that is given and that of Hertz's law at the overlap of the two
#: balls
_MOST_FACTOR = 10.0
#: least force, over the mean, that is compared so: weaker contacts may not have come to rest
_LEAST_COMPARED = 1e-3
#: least and greatest number of significant digits with which a program writes numbers
_DIGITS = (6, 15)
#: number of different values of fewer digits from which on they are rounded, not chosen
_CHOSEN = 100
#: greatest relative error of a number that is read from a text and converted into SI
_EXACT = 1e-14
#: standard error of the forces that follow from overlaps, over the forces, above which it is told,
#: and they are refused. Frequencies have a sixth of it: they are then off by 0.1 %, and by 1 %, as
#: far as elastic constants are known
_TOLD_ERROR = 6e-3
_MOST_ERROR = 6e-2
#: least difference from one that is told of a ratio: of all forces to Hertz's, of masses to those
#: of the density. A ratio of 1.05 is told, however it is rounded
_OTHER = 0.049
#: greatest scatter of a ratio that is the same for all contacts: the rounding in a file, and how
#: far balls are from rest
_SAME = 1e-4
#: the largest file of balls or contacts that is read, bytes: that of some millions of contacts
MOST_BYTES = 4_000_000_000


@dataclass(frozen=True)
class Balls:
    """What a source says of its balls, in SI; None where it says nothing.

    ``name`` is what messages call the source. Positions are (n, 1), (n, 2) or (n, 3); the rest is
    (n,). ``rounding`` and ``radius_rounding`` are the greatest errors that the digits of the source
    leave in positions and radii, m.
    """

    name: str
    positions: Array
    radii: Array
    masses: Array | None = None
    inertias: Array | None = None
    labels: Index | None = None
    rounding: Array | None = None
    radius_rounding: Array | None = None
    kinds: tuple[str, ...] | None = None

    def find_errors(self, i: Index, j: Index, normal: Array) -> tuple[Array, Array]:
        """Return the greatest and the standard error that rounding leaves in the overlaps of balls
        i and j, (n_c,), m.
        """
        width = self.positions.shape[1]
        places = np.zeros_like(self.positions) if self.rounding is None else self.rounding
        radii = np.zeros_like(self.radii) if self.radius_rounding is None else self.radius_rounding
        along = np.abs(normal[:, :width])
        greatest = np.einsum("ca,ca->c", along, places[i] + places[j]) + radii[i] + radii[j]
        squares = (
            np.einsum("ca,ca->c", along**2, places[i] ** 2 + places[j] ** 2)
            + radii[i] ** 2
            + radii[j] ** 2
        )
        # a rounded number is off by as much as by less: a third of the square
        return greatest, np.sqrt(squares / 3.0)


@dataclass(frozen=True)
class Contacts:
    """What a source says of its contacts, in SI; None where it says nothing.

    ``i`` and ``j`` are labels of balls; ``normal``, ``vector`` from ball i to ball j,
    ``tangential_force`` and ``shift`` are (n_c, 3).
    """

    name: str
    i: Index
    j: Index
    shift: Index | None = None
    vector: Array | None = None
    normal: Array | None = None
    tangential_force: Array | None = None
    normal_force: Array | None = None
    normal_stiffness: Array | None = None
    shear_stiffness: Array | None = None
    torsion_stiffness: Array | None = None
    bending_stiffness: Array | None = None
    arm_i: Array | None = None
    arm_j: Array | None = None

    def refuse(self, bad: Flags, wrong: str, why: str = "", mend: str = "") -> None:
        """Raise :class:`~granphon.base.errors.InputError` if any contact is ``bad``; the message
        names the first one.
        """
        if np.any(bad):
            raise InputError(self.describe(bad, wrong), why, mend)

    def describe(self, bad: Flags, wrong: str) -> str:
        """Say of the first contact that is ``bad`` what is ``wrong``, and how many there are."""
        first = int(np.flatnonzero(bad)[0])
        count = int(np.count_nonzero(bad))
        more = f" ({count} in all)" if count > 1 else ""
        return (
            f"{self.name}: contact {first}, of balls {self.i[first]} and {self.j[first]},"
            f" {wrong}{more}"
        )


@dataclass(frozen=True)
class Source:
    """What a source says: its balls and contacts, its cell (3, 3), m, with which of its vectors are
    periods, and the rest.

    The rest are fields of the network; None where the source says nothing of them.
    """

    balls: Balls
    contacts: Contacts
    cell: Array
    pbc: Flags
    dimension: int | None = None
    motions: str | None = None
    prestress: bool = False
    left_out: int = 0
    adhesive: bool = False
    contact_model: ContactModel | None = None

    def complete(
        self,
        material: Material | None,
        friction: bool,
        dimension: int | None,
        motions: str | None,
        prestress: bool | None,
    ) -> dict[str, Any]:
        """Return all fields of the network; what is given here counts before what the source says.

        For the arguments see :meth:`granphon.networks.network.ContactNetwork.from_table`.
        """
        balls = self.balls
        contacts = self.contacts
        dimension = self.dimension if dimension is None else dimension
        motions = self.motions if motions is None else motions
        prestress = require("prestress", truth, self.prestress if prestress is None else prestress)
        if material is not None and not isinstance(material, Material):
            raise InputError(f"the material is {brief(material)}", mend="Give a gp.Material")
        friction = require("friction", truth, friction)
        # places, sizes and vectors with which one cannot reckon
        placed = np.all(np.abs(balls.positions) < LARGEST, axis=1)
        fixed = np.zeros(len(placed), bool) if balls.masses is None else np.isinf(balls.masses)
        sized = (balls.radii > 0.0) & ((balls.radii < LARGEST) | (fixed & np.isinf(balls.radii)))
        for fine, name in ((placed, "place"), (sized, "radius")):
            if not np.all(fine):
                ball = int(np.argmin(fine))
                value = (
                    balls.positions[ball].tolist() if name == "place" else float(balls.radii[ball])
                )
                number = ball if balls.labels is None else int(balls.labels[ball])
                why = (
                    "Only a body that does not move may have a radius of inf"
                    if value == math.inf
                    else ""
                )
                raise InputError(f"{balls.name}: ball {number} has the {name} {value} m", why)
        if contacts.vector is not None:
            far = ~np.all(np.abs(contacts.vector) < LARGEST, axis=1)
            contacts.refuse(far, "has a vector that is not finite, or too large")
        if contacts.shift is not None:
            far = ~np.all(np.abs(contacts.shift) <= MOST_STEPS, axis=1)
            contacts.refuse(far, f"has a shift of more than {MOST_STEPS} cells")
        lengths = np.max(np.abs(self.cell), axis=1)
        if not (np.all(lengths < LARGEST) and np.all((lengths > 1.0 / LARGEST) | ~self.pbc)):
            raise InputError(f"the cell is {self.cell.tolist()} m", mend="Give vectors in m")
        width = balls.positions.shape[1]
        positions = np.zeros((len(balls.positions), 3))
        positions[:, :width] = balls.positions
        if dimension is None:
            dimension = 2 if width == 3 and self._is_level() else width
        dimension = whole_number("dimension", dimension, 1, 3)
        cell = self.cell
        pbc = self.pbc & (np.arange(3) < dimension)
        masses = balls.masses
        if material is not None:
            self._judge_material(material)
        if masses is None:
            if material is None:
                mend = "Give the masses, or the material of the balls"
                raise InputError(
                    f"{balls.name} has no column 'mass', and no material is given", mend=mend
                )
            masses = material.density * (4.0 / 3.0 * math.pi) * balls.radii**3
        elif material is not None:
            self._compare_masses(material)
        inertias = 0.4 * masses * balls.radii**2 if balls.inertias is None else balls.inertias
        # the indices of the balls that contacts name
        count = len(balls.positions)
        labels = np.arange(count) if balls.labels is None else balls.labels
        order = np.argsort(labels, kind="stable")
        if np.any(np.diff(labels[order]) == 0):
            twice = labels[order][:-1][np.diff(labels[order]) == 0][0]
            raise InputError(
                f"{balls.name} has two balls with the id {twice}", mend="Give each an id of its own"
            )
        ends = []
        ids = counted(count, "ball has an id", "balls have ids")
        for wanted in (contacts.i, contacts.j):
            place = np.minimum(np.searchsorted(labels[order], wanted), max(count - 1, 0))
            missing = labels[order][place] != wanted if count else np.ones(len(wanted), bool)
            named = f"There, {f'balls are 0 to {count - 1}' if balls.labels is None else ids}"
            contacts.refuse(missing, f"names a ball that is not among those of {balls.name}", named)
            ends.append(np.asarray(order[place], np.intp))
        i, j = ends
        still = np.isinf(masses[i]) | np.isinf(masses[j])
        if contacts.normal is None and np.any(still):
            contacts.refuse(
                still,
                "is with a body that does not move, and has no normal",
                mend="Give nx, ny and nz",
            )
        # whole cells by which balls j are displaced: those given, those of the vectors, or to where
        # they are nearest
        radii_i = balls.radii[i]
        radii_j = balls.radii[j]
        apart = positions[j] - positions[i]
        axes = np.flatnonzero(pbc)
        touch = radii_i + radii_j
        periods = cell[axes]
        shift = contacts.shift
        if shift is None:
            shift = np.zeros((len(i), 3), np.intp)
            if axes.size and np.linalg.matrix_rank(periods) < axes.size:
                mend = "Give other vectors, or name fewer as periodic"
                raise InputError(
                    "the periodic vectors of the cell are not independent of each other", mend=mend
                )
            across = np.linalg.pinv(periods)
            if contacts.vector is not None:
                shift[:, axes] = _round_steps((contacts.vector - apart) @ across)
                off = (
                    np.linalg.norm(apart + shift @ cell - contacts.vector, axis=1)
                    > _ROUNDED * touch
                )
                why = "Its vector does not lead from one to the other in this cell"
                mend = "Are both files of one time step?"
                turned = apart + contacts.vector
                turned[:, :] -= _round_steps(turned @ across) @ periods
                if np.all(np.linalg.norm(turned, axis=1)[~still] <= _ROUNDED * touch[~still]):
                    mend = (
                        "Turn the signs: the vector of a dump (dx, dy, dz) leads from ball j to"
                        " ball i"
                    )
                contacts.refuse(off & ~still, "is not where its balls are", why, mend)
            elif axes.size:
                nearest = -_round_steps(apart @ across)
                steps = np.stack(
                    np.meshgrid(*[[-1, 0, 1]] * axes.size, indexing="ij"), axis=-1
                ).reshape(-1, axes.size)
                away = np.stack(
                    [np.linalg.norm(apart + (nearest + step) @ periods, axis=1) for step in steps],
                    axis=1,
                )
                away[(i == j)[:, None] & np.all(nearest[:, None] + steps == 0, axis=2)] = np.inf
                shift[:, axes] = nearest + steps[np.argmin(away, axis=1)]
                # a contact of a ball with its own image leads there either way
                second = np.sort(away, axis=1)[np.arange(len(i)), np.where(i == j, 2, 1)]
                why = "The cell is so small that they touch at more than one place"
                mend = "Give the shift of each contact"
                contacts.refuse(
                    ~still & (second < touch), "is not the only one of its balls", why, mend
                )
                shift[still] = 0
        vector = positions[j] + shift @ cell - positions[i]
        distance = np.linalg.norm(vector, axis=1)
        overlap = np.where(still, 0.0, touch - distance)  # a wall may have any place
        far = ~still & ~(np.abs(overlap) <= _REACH * touch)
        said = (
            f"whose radii add up to {_first(touch, far):.6g} m, are {_first(distance, far):.6g} m"
            f" apart"
        )
        contacts.refuse(
            far,
            f"joins balls that are not near each other: these, {said}",
            mend="Compare the cell and the units",
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            normal = vector / distance[:, None] if contacts.normal is None else contacts.normal
        # force, normal and shear stiffness of each contact, as given, or by Hertz and Mindlin
        force = contacts.normal_force
        stiffness = contacts.normal_stiffness
        shear = contacts.shear_stiffness
        if force is not None:
            odd = ~(np.isfinite(force) & ((force >= 0.0) | bool(self.adhesive)))
            contacts.refuse(
                odd,
                f"has the force {_first(force, odd):.6g} N",
                "Forces that pull, or are not finite, are not of elastic balls",
                "Forces that press count as positive",
            )
        lacking = [
            name
            for name, value in (
                ("normal_force", force),
                ("normal_stiffness", stiffness),
                ("shear_stiffness", shear),
            )
            if value is None and not (name == "shear_stiffness" and not friction)
        ]
        if lacking and material is None:
            mend = "Give the material of the balls, from which they follow, or the columns"
            if lacking == ["shear_stiffness"]:
                mend = "Give the column, the material of the balls, or friction=False"
            raise InputError(
                f"{contacts.name} has no {', '.join(lacking)}, and no material is given", mend=mend
            )
        if force is None or stiffness is None:
            assert material is not None
            small = np.minimum(radii_i, radii_j)
            large = np.maximum(radii_i, radii_j)
            flat = np.isinf(large)  # the curvature of a flat wall is zero
            between = np.where(
                flat,
                4.0 * small,
                harmonic_diameter(2.0 * small, np.where(flat, small, large) * 2.0),
            )
            coefficient = HertzLaw.between(material, 1.0).coefficient * np.sqrt(between)
            unit = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
            by_overlap = partial(_force_of_overlap, coefficient, overlap)
            if force is None:
                contacts.refuse(
                    still,
                    "is with a body that does not move, and has no force",
                    mend="Give normal_force",
                )
                force = by_overlap()
                _judge_errors(contacts, balls, by_overlap, balls.find_errors(i, j, normal)[1])
            elif stiffness is None:
                _compare_forces(
                    contacts,
                    np.where(still, np.nan, force),
                    by_overlap,
                    balls.find_errors(i, j, normal)[0],
                )
            if stiffness is None:
                stiffness = coefficient * unit.stiffness(unit.overlap(force / coefficient))
        if shear is None:
            shear = stiffness * (
                material.mindlin_ratio if friction and material is not None else 0.0
            )
        none = np.zeros(len(i))
        found: dict[str, Any] = {
            "i": i,
            "j": j,
            "shift": shift,
            "normal": normal,
            "normal_force": force,
            "normal_stiffness": stiffness,
            "shear_stiffness": shear,
        }
        # the arms lead from the centres to the middle of the overlap; that of a flat wall does not
        # matter
        arm_i, arm_j = (
            np.where(np.isfinite(radii), radii, 0.0) - 0.5 * overlap for radii in (radii_i, radii_j)
        )
        rest = {
            "torsion_stiffness": none,
            "bending_stiffness": none,
            "arm_i": arm_i,
            "arm_j": arm_j,
        }
        for name, value in rest.items():
            given = getattr(contacts, name)
            found[name] = value if given is None else given
        if prestress and contacts.tangential_force is None and dimension > 1 and np.any(shear):
            what = f"{contacts.name} has no tangential forces, and its normal ones act (prestress)"
            why = (
                "Contacts that resist slip bear both, of one order: without them a packing at"
                " rest may seem unstable"
            )
            mend = (
                "Give tx, ty, tz (p1, p2, p3 of compute pair/local) or tangential_x,"
                " tangential_y, tangential_z"
            )
            warnings.warn(message(what, why, mend), InconsistencyWarning, stacklevel=3)
        if contacts.tangential_force is not None:
            found["tangential_force"] = contacts.tangential_force
        if contacts.normal_stiffness is None:
            # without force a Hertz contact has no stiffness: it is open
            found = {name: values[force > 0.0] for name, values in found.items()}
        model = self.contact_model
        if material is not None:
            size = 2.0 * float(np.mean(balls.radii[np.isfinite(balls.radii)]))
            model = ContactModel(
                (Ball(material, size),), friction=bool(np.any(shear)), own_radii=True
            )
        return {
            "cell": cell,
            "pbc": tuple(pbc.tolist()),
            "positions": positions,
            "radii": balls.radii,
            "masses": masses,
            "inertias": inertias,
            **found,
            "motions": next(iter(allowed_motions(dimension))) if motions is None else motions,
            "dimension": dimension,
            "prestress": prestress,
            "left_out": self.left_out,
            "labels": balls.labels,
            "kinds": balls.kinds,
            "adhesive": self.adhesive,
            "contact_model": model,
        }

    def _is_level(self) -> bool:
        """Whether all balls are at one height z, and no contact leads up or down. A flat wall may
        have any place.
        """
        balls = self.balls
        normal = self.contacts.normal
        solid = np.isfinite(balls.radii)
        heights = balls.positions[solid, 2]
        level = heights.size > 0 and np.ptp(heights) <= _LEVEL * np.max(balls.radii[solid])
        return bool(level and (normal is None or np.all(np.abs(normal[:, 2]) <= _LEVEL)))

    def _judge_material(self, material: Material) -> None:
        """Warn of a density or a Young modulus that was probably given in another unit, where the
        network depends on it.
        """
        for attribute, name, unit, limit, at_least in BALL_LIMITS.values():
            used = attribute != "material.density" or self.balls.masses is None
            if not attribute.startswith("material.") or not used:
                continue
            value = float(getattr(material, attribute.removeprefix("material.")))
            if value < limit if at_least else value > limit:
                what = (
                    f"the {name} of the material is {value:g} {unit},"
                    f" {'below' if at_least else 'above'} {limit:g} {unit}"
                )
                warnings.warn(
                    message(what, WRONG_UNIT.capitalize()), InconsistencyWarning, stacklevel=4
                )

    def _compare_masses(self, material: Material) -> None:
        """Warn if the masses that are given are not those of solid balls of the material."""
        balls = self.balls
        assert balls.masses is not None
        moving = np.isfinite(balls.masses) & np.isfinite(balls.radii)
        if not np.any(moving):
            return
        solid = material.density * (4.0 / 3.0 * math.pi) * balls.radii[moving] ** 3
        with np.errstate(all="ignore"):
            # sizes and masses that cannot be reckoned with are refused later
            ratio = float(np.median(balls.masses[moving] / solid))
        if math.isfinite(ratio) and abs(ratio - 1.0) >= _OTHER:
            what = (
                f"{balls.name}: the masses are {ratio:.4g} times those of solid balls of"
                f" {material.density:g} kg/m3"
            )
            why = "The masses count, and the density of the material does not"
            mend = (
                "Compare units and material. If balls are not solid, give the density of mass"
                " over volume"
            )
            warnings.warn(message(what, why, mend), InconsistencyWarning, stacklevel=4)


def _force_of_overlap(coefficient: Array, overlap: Array, off: Array | float = 0.0) -> Array:
    """Return the forces (n_c,) of Hertz's law at overlaps that are off by so much, m."""
    return np.asarray(coefficient * HertzLaw(1.0).force(overlap + off))


def _judge_errors(
    contacts: Contacts, balls: Balls, by_overlap: Callable[..., Array], error: Array
) -> None:
    """Refuse forces that follow from overlaps with too few digits, or warn of them; ``error`` is
    that of each overlap, m.
    """
    spread = float(np.sum(by_overlap(error) - by_overlap(-error))) / 2.0
    total = float(np.sum(by_overlap()))
    part = spread / total if spread < total else 1.0
    if part <= _TOLD_ERROR:
        return
    what = (
        f"{contacts.name} has no forces, and those of the overlaps are off by"
        f" {part:.{0 if part > 0.1 else 1}%}, as"
        f" places of {balls.name} are rounded: {float(np.max(error)):.2g} m in an overlap"
    )
    mend = (
        "Write places with more digits (in LAMMPS: dump_modify 1 format float %.16g), or give the"
        " forces"
    )
    if part > _MOST_ERROR:
        raise InputError(what, "An overlap is a small difference of places", mend)
    warnings.warn(message(what, mend=mend), InconsistencyWarning, stacklevel=4)


def _compare_forces(
    contacts: Contacts, force: Array, by_overlap: Callable[..., Array], error: Array
) -> None:
    """Warn if forces are not those of Hertz's law at the overlaps, whose greatest ``error`` is
    known, m.

    A force of nan is not compared.
    """
    least, made, most = (by_overlap(off) for off in (-error, 0.0, error))
    odd = (force / _MOST_FACTOR > most) | (force < least / _MOST_FACTOR)
    odd &= np.maximum(force, least) > _LEAST_COMPARED * np.nansum(force / force.size)
    if np.any(odd):
        wrong = (
            f"has the force {_first(force, odd):.6g} N, and the overlap of its balls makes"
            f" {_first(made, odd):.6g} N"
        )
        mend = (
            "Compare units, material and columns. If the law is not Hertz's, give the stiffnesses"
        )
        warnings.warn(
            message(contacts.describe(odd, wrong), mend=mend), InconsistencyWarning, stacklevel=4
        )
        return
    strong = (made > 0.0) & (force >= np.nansum(force / force.size))
    if not np.any(strong):
        return
    ratio = force[strong] / made[strong]
    factor = float(np.median(ratio))
    scatter = float(np.median(np.abs(ratio / factor - 1.0)))
    rounding = float(np.median((most - least)[strong] / (2.0 * made[strong])))
    if scatter <= _SAME + rounding and abs(factor - 1.0) >= _OTHER + rounding:
        what = (
            f"{contacts.name}: all forces are {factor:.4g} times those of Hertz's law at the"
            f" overlaps"
        )
        mend = "Compare units and Young's modulus. If the law is not Hertz's, give the stiffnesses"
        warnings.warn(
            message(what, "The material or the law is another one", mend),
            InconsistencyWarning,
            stacklevel=4,
        )


def read_whole_numbers(name: str, values: Any) -> Index:
    """Return ``values`` as an array of whole numbers; floats are taken if they are whole.

    Raises :class:`~granphon.base.errors.InputError` for other values, and for numbers too large to
    be an index.
    """
    given = (
        values
        if isinstance(values, np.ndarray) and values.dtype.kind == "i"
        else real_array(name, values)
    )
    if given.dtype.kind == "i":
        return np.asarray(given, np.intp)
    fine = np.isfinite(given) & (given == np.rint(given)) & (np.abs(given) < 2.0**53)
    if not np.all(fine):
        wrong = given[~fine].ravel()[0]
        raise InputError(
            f"{name} of the network has the number {wrong!s} where a whole number is needed"
        )
    return np.asarray(given, np.intp)


def find_rounding(values: Array) -> Array:
    """Return half a unit of the last digit of each of ``values``, of one source: their greatest
    errors, of the same shape.

    How many digits the source writes follows from all of its numbers. Where all are whole multiples
    of the last digit of the largest, it writes as many decimals of each. Numbers that single
    precision holds have its digits. A few numbers of fewer digits than a program writes were chosen
    so, and have no error.
    """
    size = np.abs(values)
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    known = (size < LARGEST) & (size > 1.0 / LARGEST)  # others are refused, or play no part
    digits = _count_digits(size[known])
    if digits < _DIGITS[0] and np.unique(size[known]).size < _CHOSEN:
        return np.zeros(values.shape)
    if digits >= _DIGITS[0] and np.array_equal(single[known], values[known]):
        return np.where(
            known, 0.5 * np.spacing(np.where(known, np.abs(single), np.float32(1.0))), 0.0
        )
    last = 10.0 ** (np.floor(np.log10(np.where(known, size, 1.0))) - digits + 1.0)
    coarsest = float(np.max(last[known]))
    steps = size[known] / coarsest
    if np.allclose(steps, np.rint(steps), rtol=_EXACT, atol=0.0):
        last = np.full(values.shape, coarsest)
    return np.where(known, 0.5 * last, 0.0)


def _count_digits(sizes: Array) -> int:
    """Return the number of significant digits that all of ``sizes``, above zero, do with; that of
    floats at most.
    """
    leading = sizes / 10.0 ** np.floor(np.log10(sizes))
    for digits in range(1, _DIGITS[1]):
        power = 10.0 ** (digits - 1)
        if np.allclose(np.rint(leading * power) / power, leading, rtol=_EXACT, atol=0.0):
            return digits
    return _DIGITS[1]


def _first(values: Array, bad: Flags) -> float:
    return float(values[np.argmax(bad)]) if np.any(bad) else math.nan


def _round_steps(steps: Array) -> Index:
    """Return the nearest whole numbers of cells; :class:`InputError` if balls are too many cells
    from each other.
    """
    if np.any(~(np.abs(steps) <= MOST_STEPS)):
        raise InputError(
            f"balls that touch are more than {MOST_STEPS} cells apart",
            mend="Compare cell and places",
        )
    return np.asarray(np.rint(steps), np.intp)
