"""Derivatives of elastic moduli and sound velocities with respect to the stiffnesses of contacts
and the masses of balls.

A uniform strain deforms each contact once the balls have moved and turned to where no force is left
on them. There the energy is least, so that its derivative by a stiffness is the product of the
deformations of that contact alone (:attr:`ContactLattice.gradient_deformations`): one solution of
the equations of balance serves for all contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from granphon.balls.layers import find_axes
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError
from granphon.base.results import held, result_class
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.elasticity import find_stress_part, voigt_pairs
from granphon.dynamics.sensitivities import (
    STIFFNESSES,
    Sensitivities,
    add_static,
    average_equal,
    list_contact_units,
    name_units,
    number_equal,
    sum_kinds,
    turn_motions,
)
from granphon.media.state import State
from granphon.networks.network import ContactNetwork, given_network


@result_class
class ModuliSensitivities(Sensitivities):
    """Derivatives of elastic constants, Pa (N on a line) over the unit of each parameter; see
    :class:`Sensitivities`. The axes are those of the load, then those of ``tensor``, (v, v).

    No mass changes a modulus: ``mass`` and ``inertia`` are None. ``shear_stiffness`` is None where
    balls do not turn and no contact resists slip: a spring against slip would turn the balls.
    ``on_site`` is None: springs to the ground leave no moduli, but for springs against rotations of
    balls with one period, by which no derivatives are found.
    """

    units: ClassVar[dict[str, str]] = name_units("Pa")

    def _field_units(self) -> dict[str, str]:
        """Return the SI unit of each field; the one modulus of a network on a line is in N."""
        n_strains = self.normal_stiffness.shape[-2]
        return name_units("N") if n_strains == 1 else dict(self.units)


@result_class
class VelocitySensitivities(Sensitivities):
    """Derivatives of sound velocities, m/s over the unit of each parameter; see
    :class:`Sensitivities`. The axes are those of ``velocities``.

    No moment of inertia changes a long wave: ``inertia`` is None. ``shear_stiffness`` is None where
    balls do not turn and no contact resists slip, as of moduli. ``on_site`` is nan against
    displacements, as springs against these leave no sound.

    Attributes
    ----------
    velocities : (..., n_u) m/s, ascending. The derivatives are nan where a velocity is zero.
    degenerate : (..., n_u) whether another wave has the same velocity: the derivative is then that
        of their mean.
    """

    units: ClassVar[dict[str, str]] = name_units("m/s")

    velocities: Array = held(float, "...", "m/s", "zero or above")
    degenerate: Flags = held(bool, "*")


def list_networks(state: State | None, quantity: str) -> list[ContactNetwork]:
    """Return the network at each load of a state, in C order.

    Raises InputError if ``state`` is None, as it is for a result that was copied or read from a
    file, and if the state has samples, each of which has a network of its own. The ``quantity`` is
    the name of the public function whose result asks, such as "moduli", for the message.
    """
    quantity_in_words = quantity.replace("_", " ")
    if state is None:
        raise InputError(
            f"these {quantity_in_words} have no network",
            "They were copied or read, and nothing says of which contacts they are",
            "Find them again from the state",
        )
    if getattr(state, "samples", ()):
        raise InputError(
            f"the {quantity_in_words} of a simulation are means over samples",
            "Each sample has contacts of its own",
            f"Give a sample: gp.{quantity}(state.samples[0]).sensitivities",
        )
    if state.is_single:
        return [given_network(state)]
    states: Any = state  # a state at several loads has an index
    return [given_network(states[index]) for index in np.ndindex(state.shape)]


def find_moduli_sensitivities(
    networks: list[ContactNetwork], shape: tuple[int, ...]
) -> ModuliSensitivities:
    """Return the derivatives of the elastic tensors of ``networks``, one for each load, in C order;
    the loads have this ``shape``.
    """
    slopes = [_find_tensor_slopes(network) for network in networks]
    return ModuliSensitivities(**_stack(slopes, shape), mass=None, inertia=None, on_site=None)


def find_velocity_sensitivities(
    networks: list[ContactNetwork], shape: tuple[int, ...], direction: Array
) -> VelocitySensitivities:
    """Return the derivatives of the velocities along a ``direction`` (p,), or (n, p), in
    ``networks``, one for each load, in C order; the loads have this ``shape``.
    """
    slopes = [_find_velocity_slopes(network, direction) for network in networks]
    return VelocitySensitivities(**_stack(slopes, shape), inertia=None)


def _stack(fields_of_loads: list[dict[str, Any]], shape: tuple[int, ...]) -> dict[str, Any]:
    """Return arrays by name, with the ``shape`` of the load in front, from ``fields_of_loads``: the
    arrays by name at each load, in C order. What is None at the first load is None at all loads,
    and stays None.
    """
    fields: dict[str, Any] = {}
    for name, first_field in fields_of_loads[0].items():
        fields[name] = None
        if first_field is not None:
            stacked = np.array([field[name] for field in fields_of_loads])
            fields[name] = stacked.reshape(*shape, *first_field.shape)
    return fields


def _make_slopes(network: ContactNetwork, products: dict[str, Array]) -> dict[str, Any]:
    """Return the derivatives (..., n_c) of an SI quantity by the SI parameters of contacts of a
    ``network``, by the names of the parameters. ``products`` (n_c, ...), one or more by name, are
    the derivatives of the SI quantity by reduced parameters: sums of products of deformations. None
    stands for parameters that the network does not have.
    """
    fields: dict[str, Any] = dict.fromkeys(STIFFNESSES.values())
    # by a parameter without products: zero, and nan where no parameter has a derivative
    no_products = 0.0 * next(iter(products.values()))
    by_contact = list_contact_units(network, network.scales)
    if not (network.ball_motions.rotate or np.any(network.shear_stiffness)):
        # a first spring against slip would turn the balls, which the network does not let turn
        del by_contact["shear_stiffness"]
    for name, unit in by_contact.items():
        fields[name] = np.moveaxis(products.get(name, no_products), 0, -1) / unit
    by_growth = fields.pop("tangential_growth")
    by_excess = fields.pop("excess")
    if network.prestress:
        add_static(fields, network, by_growth, by_excess)
    return fields


def _sum_products(lattice: ContactLattice, multiply: Callable[[Array], Array]) -> dict[str, Array]:
    """Return for each parameter of the contacts of a ``lattice``, by its name, the sum (n_c, ...)
    of products over the rows of the compatibility matrix that the parameter weights.

    ``multiply`` takes the deformations (n_c, n_u, p) of the contacts in one kind of row, one for
    each component of a gradient of n_u displacements along p periods, and returns their products
    (n_c, ...).
    """
    rows, deformations = lattice.gradient_deformations
    products = [multiply(deformation[: lattice.n_between]) for deformation in deformations]
    return sum_kinds(rows, np.concatenate(products))


def _find_tensor_slopes(network: ContactNetwork) -> dict[str, Any]:
    """Return the derivatives (v, v, n_c) of the elastic tensor of a network, whose v strains are in
    Voigt order, by the names of parameters; None for those that the network does not have.
    """
    lattice = ContactLattice.from_network(network)
    lattice.elastic_tensor()  # raises where there is none
    p = lattice.periods
    products = _sum_products(lattice, partial(_multiply_strains, lattice))
    if network.prestress:
        vector = lattice.contacts.vector[:, :p]
        stress = vector[:, :, None] * vector[:, None]
        # the static stress itself is part of the tensor
        by_normal_force = products.get("normal_force", 0.0)
        products["normal_force"] = by_normal_force + find_stress_part(stress)
    units = network.scales
    unit = units.force if p == 1 else units.modulus
    scaled = {name: product * unit / lattice.measure for name, product in products.items()}
    return _make_slopes(network, scaled)


def _multiply_strains(lattice: ContactLattice, deformation: Array) -> Array:
    """Return the products (n_c, v, v) of the deformations of contacts under each two of the v
    strains of a ``lattice`` in Voigt order, from their ``deformation`` (n_c, n_u, p) under the
    gradients of n_u displacements along p periods.
    """
    p = lattice.periods
    # the translations along the periods, which strains move
    along_periods = [lattice.motions.translations.index(axis) for axis in range(p)]
    gradients = deformation[:, along_periods]
    i, j = np.transpose(voigt_pairs(p))
    # (n_c, v): a strain has both gradients in equal parts
    strains = 0.5 * (gradients[:, i, j] + gradients[:, j, i])
    return np.asarray(strains[:, :, None] * strains[:, None])


def _find_velocity_slopes(network: ContactNetwork, direction: Array) -> dict[str, Any]:
    """Return the velocities v in a ``network`` along a ``direction`` (p,) or (n, p), SI, and their
    derivatives, by the names of the fields of :class:`VelocitySensitivities`; see there for their
    shapes.

    With M the mass of all balls, M v^2 is the sum of stiffnesses times squared deformations in a
    wave, so that a derivative of v is one of that sum over 2 M v. A mass m takes part in M v^2 with
    its kinetic energy instead: see :func:`_find_mass_slopes`.
    """
    lattice = ContactLattice.from_network(network)
    waves = _SoundWaves.along(lattice, direction)
    unit = network.scales.velocity
    products = _sum_products(lattice, waves.square)
    fields = _make_slopes(network, {name: unit * product for name, product in products.items()})
    return fields | {
        "mass": _find_mass_slopes(network, lattice, waves),
        "on_site": _find_spring_slopes(network, lattice, waves),
        "velocities": unit * waves.velocities,
        "degenerate": waves.are_degenerate,
    }


def _find_mass_slopes(
    network: ContactNetwork, lattice: ContactLattice, waves: _SoundWaves
) -> Array:
    """Return the derivatives (..., n_u, n_balls) of the velocities of the ``waves`` in the
    ``lattice`` of a ``network`` by the masses of its balls, SI; zero of balls that do not move.

    A mass m takes part in M v^2 with m v^2 times its squared displacement, which counts with a
    minus.
    """
    # (balls, ..., n_u, n_u) displacements of each ball, as columns, in each wave
    displacements = np.einsum("bij,...ju->b...iu", lattice.carried, waves.vectors)
    kinetic_parts = np.sum(displacements**2, axis=-2) * waves.velocities**2
    unit = network.scales.velocity / network.scales.mass
    slopes = np.zeros((network.n_balls, *waves.velocities.shape))
    slopes[network.moving] = -unit * waves.average(kinetic_parts)
    return np.moveaxis(slopes, 0, -1)


def _find_spring_slopes(
    network: ContactNetwork, lattice: ContactLattice, waves: _SoundWaves
) -> Array:
    """Return the derivatives (..., n_u, n_balls, motions) of the velocities of the ``waves`` in the
    ``lattice`` of a ``network`` by springs to the ground against each motion of its balls, SI.

    Springs against displacements leave no sound: the derivatives by these are nan. All derivatives
    are zero of balls that do not move.
    """
    motions = network.ball_motions
    products = waves.square(_list_turns(network, lattice))
    shape = waves.velocities.shape
    # springs against rotations are in N m over an angle in rad
    unit = network.scales.velocity / (network.scales.stiffness * network.scales.length**2)
    slopes = np.full((network.n_balls, motions.count, *shape), np.nan)
    slopes[~network.moving] = 0.0
    slopes[network.moving, motions.turning] = unit * products.reshape(
        lattice.n_balls, len(motions.rotations), *shape
    )
    return np.moveaxis(slopes, (0, 1), (-2, -1))


@dataclass(frozen=True, eq=False)
class _SoundWaves:
    """The sound waves of a lattice along one or more directions, in reduced units.

    Attributes
    ----------
    direction : unit vector (p,), or (n, p) of several.
    velocities : (..., n_u) ascending velocities v; the first axis is that of several directions.
    vectors : (..., n_u, n_u) columns of displacements, with which the mass that each wave moves is
        M, the mass of all balls.
    groups : (..., n_u) numbers that waves of one velocity have in common.
    slopes : (..., n_u) derivatives of v by M v^2; nan for a velocity of zero, which has none.
    """

    direction: Array
    velocities: Array
    vectors: Array
    groups: Index
    slopes: Array

    @classmethod
    def along(cls, lattice: ContactLattice, direction: Array) -> _SoundWaves:
        """Return the waves of a ``lattice`` along a ``direction`` (p,), or along each of several
        (n, p).
        """
        velocities, polarisations = lattice.sound_velocities(direction)
        order = np.argsort(velocities, axis=-1, kind="stable")
        ascending = np.take_along_axis(velocities, order, -1)
        vectors = lattice.root_mass_ratio @ np.take_along_axis(
            polarisations, order[..., None, :], -1
        )
        slopes = np.full(ascending.shape, np.nan)
        momenta = 2.0 * ascending * lattice.masses.sum()
        np.divide(1.0, momenta, out=slopes, where=ascending > 0.0)
        return cls(direction, ascending, vectors, number_equal(ascending), slopes)

    @property
    def are_degenerate(self) -> Flags:
        """(..., n_u) whether other waves have the same velocity."""
        sizes = np.sum(self.groups[..., :, None] == self.groups[..., None, :], axis=-1)
        return np.asarray(sizes > 1)

    def square(self, deformation: Array) -> Array:
        """Return the derivatives (m, ..., n_u) of v by m stiffnesses: they follow from the squares
        of the ``deformation`` (m, n_u, p) that each stiffness resists, one for each component of a
        gradient of displacement.
        """
        # a wave u along the direction j has the gradients (displacement i) x (component j)
        deformations_in_waves = np.einsum(
            "cij,...iu,...j->c...u", deformation, self.vectors, self.direction
        )
        return self.average(deformations_in_waves**2)

    def average(self, values: Array) -> Array:
        """Return the derivatives (m, ..., n_u) of v that follow from the ``values`` (m, ..., n_u),
        derivatives of M v^2 by m parameters; each wave has the mean over all waves of the same
        velocity.
        """
        scaled = np.moveaxis(values, 0, -2) * self.slopes[..., None, :]
        # (directions, m, n_u) and (directions, n_u)
        slopes_of_directions = scaled.reshape(math.prod(scaled.shape[:-2]), *scaled.shape[-2:])
        groups_of_directions = self.groups.reshape(-1, self.groups.shape[-1])
        means = [
            average_equal(slopes, groups, groups)
            for slopes, groups in zip(slopes_of_directions, groups_of_directions, strict=True)
        ]
        return np.moveaxis(np.reshape(means, scaled.shape), -2, 0)


def _list_turns(network: ContactNetwork, lattice: ContactLattice) -> Array:
    """Return how the balls of the ``lattice`` of a network rotate in a long wave: (n_balls x
    rotations, n_u, p), for each component of the displacement and each axis of its gradient. The
    rotations are about the axes of the network.
    """
    frame = find_axes(network.cell[network.pbc, : network.dimension])
    motions = turn_motions(lattice.motions, frame.T) @ lattice.gradient_motions
    turns = motions[:, lattice.motions.turning] / lattice.gyration[:, None, None]
    return turns.reshape(-1, len(lattice.motions.translations), lattice.periods)
