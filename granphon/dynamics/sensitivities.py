"""Derivatives of frequencies, and of other results, with respect to the stiffnesses of contacts and
the masses of balls.

A mode u of norm one, u^H M u = 1, has the squared angular frequency omega^2 = u^H C^H K C u.
However the mode changes, to first order omega^2 changes as if it did not (R. P. Feynman, Phys. Rev.
56, 340, 1939):

    d omega^2 / d k  =  |c u|^2             c: row of the deformation that the stiffness k resists
    d omega^2 / d g  =  |u_a|^2             g: spring to the ground against the motion a of a ball
    d omega^2 / d m  =  -omega^2 |u|^2      u: displacement of the ball, or rotation for an inertia
    d omega^2 / d f  =  -|v|^2 / r          v: displacement across a contact that presses with f

Static tangential forces T may grow with the overlap, by a part of T that goes as k/f of the
contact (:attr:`ContactNetwork.tangential_growth`): it changes with both.

Modes of one frequency split in another way for each parameter, but their mean has a derivative: the
mean of these expressions over any basis of the modes (T. Kato, Perturbation Theory for Linear
Operators, 1966, section II.5.4). A frequency of zero is the root of a square that is zero, and has
no derivative.

Each kind of rows has the name of its stiffness in :data:`STIFFNESSES`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from granphon.balls.motions import Motions
from granphon.base.arrays import Array, Flags, Index
from granphon.base.results import Result, held, result_class
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.dynamics.deformation_rows import EXCESS, GROWTH, Row
from granphon.networks.network import ContactNetwork

#: the field of :class:`Sensitivities` that holds the derivative by the stiffness against each kind
#: of deformation, or by the force that acts on it
STIFFNESSES = {
    "elongation": "normal_stiffness",
    "slip": "shear_stiffness",
    "twist": "torsion",
    "roll": "bending",
    "push": "normal_force",
    GROWTH: "tangential_growth",
    EXCESS: "excess",
}
#: units of what derivatives are taken by
_UNITS = {
    "normal_stiffness": "N/m",
    "shear_stiffness": "N/m",
    "torsion": "N m",
    "bending": "N m",
    "mass": "kg",
    "inertia": "kg m^2",
    "normal_force": "N",
    "on_site": "N/m or N m",
}
#: relative difference of frequencies up to which branches are equal
_FREQUENCY_ROUNDING = 1e-8


def name_units(unit: str) -> dict[str, str]:
    """Return the units of the fields of :class:`Sensitivities` of results in ``unit``."""
    units = {}
    for name, parameter_unit in _UNITS.items():
        divisor = parameter_unit if parameter_unit.isalpha() else f"({parameter_unit})"
        units[name] = f"{unit}/{divisor}"
    return units


@result_class
class Sensitivities(Result):
    """Derivatives of results of a network; SI units. Contacts and balls are those of the network,
    in its order; the axes of the results come first. A field is None if the result does not depend
    on the parameter, as moduli do not depend on masses.

    Each derivative is by one number alone, while all others stay: the shear stiffness of a contact
    does not follow its normal stiffness, nor the inertia of a ball its mass.

    Attributes
    ----------
    normal_stiffness, shear_stiffness : (..., n_c), by N/m of each contact.
    torsion, bending : (..., n_c), by N m against twist and against rolling.
    mass, inertia : (..., n), by kg and kg m^2 of each ball; zero of balls that do not move.
    normal_force : (..., n_c), by N of the static force that presses each contact, whose direction
        stays; None where static forces do not act.
    on_site : (..., n, motions), by N/m and N m of a spring to the ground against each displacement
        and rotation of each ball, whether there is one or not; zero of balls that do not move.
    """

    normal_stiffness: Array = held(float, "... c")
    shear_stiffness: Array | None = held(float, "... c?")
    torsion: Array | None = held(float, "... c?")
    bending: Array | None = held(float, "... c?")
    mass: Array | None = held(float, "... n?")
    inertia: Array | None = held(float, "... n?")
    normal_force: Array | None = held(float, "... c?")
    on_site: Array | None = held(float, "... n a?")


@result_class
class FrequencySensitivities(Sensitivities):
    """Derivatives of frequencies, Hz over the unit of each parameter; see :class:`Sensitivities`.

    Attributes
    ----------
    frequencies : (...) Hz: (n_q, n_b) of wave vectors and branches, (m,) of modes, (n, 2) of the
        edges of gaps. The derivatives are nan where a frequency is zero: it has none.
    degenerate : (...) whether other branches have the same frequency: the derivative is then that
        of their mean.
    qpoints : (..., 3) wave vectors of the edges of gaps, fractions of the reciprocal cell; None of
        frequencies at wave vectors that are given, or without any.
    warnings : one sentence for each limit of the model that the state exceeds, and one that counts
        the frequencies of zero.
    """

    units: ClassVar[dict[str, str]] = name_units("Hz")
    _notebook_fields = ("warnings",)

    frequencies: Array = held(float, "...", "Hz", "zero or above")
    degenerate: Flags = held(bool, "*")
    qpoints: Array | None = held(float, "... 3?", default=None)
    warnings: tuple[str, ...] = held((str, ...), default=())


class ModeEnergies(NamedTuple):
    """What the derivatives of frequencies are made of, for modes of norm one; means over modes of
    one frequency.

    Attributes
    ----------
    frequencies : (..., b) angular.
    degenerate : (..., b) whether a mode shares its frequency with others.
    squares : (..., b, n_c) for each kind of row the squares of deformations, by the names of
        :data:`STIFFNESSES`.
    motions : (..., b, n, motions) the squares of mass-weighted motions: the part of the kinetic
        energy in each.
    """

    frequencies: Array
    degenerate: Flags
    squares: dict[str, Array]
    motions: Array

    def reshape(self, shape: tuple[int, ...]) -> ModeEnergies:
        """Return these energies with the axes of modes in another ``shape``."""
        return ModeEnergies(
            self.frequencies.reshape(shape),
            self.degenerate.reshape(shape),
            {
                name: squares.reshape(*shape, squares.shape[-1])
                for name, squares in self.squares.items()
            },
            self.motions.reshape(*shape, *self.motions.shape[-2:]),
        )


class Place(NamedTuple):
    """Which balls and contacts of a network a lattice has.

    Attributes
    ----------
    network : the network.
    units : reduced units of the lattice.
    balls : (m,) numbers in the network of the balls of the lattice.
    contacts : (m_c,) numbers in the network of the contacts of the lattice.
    """

    network: ContactNetwork
    units: Units
    balls: Index
    contacts: Index


def turn_motions(motions: Motions, axes: Array) -> Array:
    """Return the matrix (motions, motions) that takes the ``motions`` of a ball to those along and
    about other axes, unit vectors which are the rows of ``axes`` (d, d).
    """
    d = len(axes)
    in_space = np.eye(3)
    in_space[:d, :d] = axes
    matrix = np.zeros((motions.count, motions.count))
    for block, block_axes in (
        (motions.translating, motions.translations),
        (motions.turning, motions.rotations),
    ):
        matrix[block, block] = in_space[np.ix_(block_axes, block_axes)]
    return matrix


def list_inertias(network: ContactNetwork) -> Array:
    """Return (n, motions), for each motion of each ball of a ``network``, the mass, kg, or the
    moment of inertia, kg m^2.
    """
    pair = np.column_stack([network.masses, network.inertias])
    return pair[:, network.ball_motions.is_rotation.astype(int)]


def sum_kinds(rows: Sequence[Row], products: Array) -> dict[str, Array]:
    """Return the sums over the rows of each kind, (n_c, ...), of ``products`` (rows x n_c, ...)
    times the stiffness of the row, by the names of :data:`STIFFNESSES`. Stiffnesses are numbers, or
    (n_c,) if ``products`` have no further axes.
    """
    by_row = products.reshape(len(rows), -1, *products.shape[1:])
    sums: dict[str, Array] = {}
    for row, values in zip(rows, by_row, strict=True):
        name = STIFFNESSES[row.kind]
        product = row.stiffness * values
        sums[name] = sums[name] + product if name in sums else product
    return sums


def list_contact_units(network: ContactNetwork, units: Units) -> dict[str, Any]:
    """Return what one in the reduced ``units`` is in SI, for each parameter of the contacts of a
    ``network`` by which derivatives are found: a number, or (n_c,). Derivatives by "normal_force"
    are found by minus the force over the distance of the balls, so that the unit contains minus
    this distance.
    """
    twist_unit = units.stiffness * units.length**2
    by_contact: dict[str, Any] = {
        "normal_stiffness": units.stiffness,
        "shear_stiffness": units.stiffness,
        "torsion": twist_unit,
        "bending": twist_unit,
    }
    if network.prestress:
        by_contact["normal_force"] = -units.stiffness * network.distance
        by_contact["tangential_growth"] = 1.0 / units.length
        by_contact["excess"] = units.stiffness
    return by_contact


def add_static(fields: dict[str, Any], network: ContactNetwork, slopes: Any, excess: Any) -> None:
    """Add to the ``fields`` of :class:`Sensitivities`, in place, what follows from other effects of
    the static forces of a ``network`` than their push, (..., n_c).

    To normal_stiffness and normal_force is added what follows from the growth of tangential forces:
    ``slopes`` are the derivatives by that growth, over 1/m. To shear_stiffness is added the
    ``excess``, derivatives over N/m, of slip by levers that exceed the arms.
    """
    if fields.get("shear_stiffness") is not None:
        fields["shear_stiffness"] = fields["shear_stiffness"] + excess
    growth = network.tangential_growth
    for name, sign, values in (
        ("normal_stiffness", 1.0, network.normal_stiffness),
        ("normal_force", -1.0, network.normal_force),
    ):
        change = np.divide(sign * growth, values, out=np.zeros_like(growth), where=growth > 0.0)
        fields[name] = fields[name] + change * slopes


def number_equal(frequencies: Array) -> Index:
    """Return (..., b) numbers that are the same for branches of one frequency, ascending as the
    ``frequencies`` (..., b) are.
    """
    steps = np.diff(frequencies, axis=-1)
    is_above = steps > _FREQUENCY_ROUNDING * frequencies[..., 1:]
    numbers = np.zeros(frequencies.shape, np.intp)
    numbers[..., 1:] = np.cumsum(is_above, axis=-1)
    return numbers


def average_equal(values: Array, groups: Index, group_of_branch: Index) -> Array:
    """Return (..., b), for each branch the mean of ``values`` (..., m) over the modes of its group.

    ``groups`` (m,), ascending, are the numbers of the groups of the modes, and ``group_of_branch``
    (b,) those of the groups of the branches.
    """
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    counts = np.diff(starts, append=len(groups))
    means = np.add.reduceat(values, starts, axis=-1) / counts
    return np.asarray(means[..., np.searchsorted(groups[starts], group_of_branch)])


def find_frequency_sensitivities(
    energies: ModeEnergies,
    place: Place,
    warnings: tuple[str, ...] = (),
    qpoints: Array | None = None,
) -> FrequencySensitivities:
    """Return the derivatives of frequencies, in SI, from the ``energies`` of modes in reduced
    units; ``place`` says which balls and contacts they have in the network.

    ``warnings`` are those of the state, to which one that counts the frequencies of zero is added;
    ``qpoints`` (..., 3) are those of :class:`FrequencySensitivities`.
    """
    network = place.network
    units = place.units
    frequencies = energies.frequencies * units.frequency
    # from derivatives of omega^2 to those of f: 1/(8 pi^2 f); a frequency of zero has none
    slope = np.full(frequencies.shape, np.nan)
    np.divide(1.0, 8.0 * np.pi**2 * frequencies, out=slope, where=frequencies > 0.0)
    squared_omega = (2.0 * np.pi * frequencies)[..., None] ** 2
    fields: dict[str, Any] = dict.fromkeys(_UNITS)
    shape = (*frequencies.shape, network.n_contacts)
    for name, unit in list_contact_units(network, units).items():
        derivatives = np.zeros(shape)
        if name in energies.squares:
            derivatives[..., place.contacts] = energies.squares[name]
            # one of omega^2 in reduced units is a stiffness over a mass
            derivatives /= unit * (units.mass / units.stiffness)
        derivatives *= slope[..., None]
        fields[name] = derivatives
    if network.prestress:
        add_static(fields, network, fields.pop("tangential_growth"), fields.pop("excess"))
    motions = network.ball_motions
    of_balls = np.zeros((*frequencies.shape, network.n_balls, motions.count))
    of_balls[..., place.balls, :] = energies.motions / list_inertias(network)[place.balls]
    on_site = slope[..., None, None] * of_balls
    fields["on_site"] = on_site
    fields["mass"] = -squared_omega * on_site[..., motions.translating].sum(axis=-1)
    fields["inertia"] = -squared_omega * on_site[..., motions.turning].sum(axis=-1)
    return FrequencySensitivities(
        **fields,
        frequencies=frequencies,
        degenerate=energies.degenerate,
        qpoints=qpoints,
        warnings=warnings + warn_of_zeros(frequencies),
    )


def warn_of_zeros(values: Array) -> tuple[str, ...]:
    """Return one sentence that counts the ``values`` (...) of zero, which have no derivative; an
    empty tuple if there are none.
    """
    count = int(np.count_nonzero(values == 0.0))
    if not count:
        return ()
    are_zero = "is zero and has no derivative" if count == 1 else "are zero and have no derivative"
    return (f"{count} of {counted(values.size, 'value')} {are_zero}",)
