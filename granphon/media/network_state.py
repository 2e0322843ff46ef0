"""A network of contacts as the state of what repeats without end: the cell of a crystal, a ribbon, a sample's own cell."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, brief, message
from granphon.base.scales import Units
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.tensors import is_cubic
from granphon.media.state import ContactState, State
from granphon.networks.network import ContactNetwork, given_network, refuse_unpressed

Array = NDArray[np.float64]


class NetworkState(State):
    """The state that a network with periods is: its contacts, with a stiffness and a force for each.

    Lengths, stiffnesses and masses are in the reduced units of the network, :attr:`ContactNetwork.scales`.

    Parameters
    ----------
    network : it repeats along one, two or three axes.
    warnings : what those who made it say of its limits, one sentence each; None for what the network itself shows.
    """

    name = "network"
    shape = ()
    has_one_lattice = True

    def __init__(self, network: ContactNetwork, warnings: tuple[str, ...] | None = None) -> None:
        self.network, self.warnings = network, warnings
        self._lattice = ContactLattice.from_network(network)

    def contact_lattice(self) -> ContactLattice:
        """Return the lattice of contacts, in reduced units."""
        return self._lattice

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of the balls that move, in the order of the lattice; empty if they are not known."""
        return tuple(itertools.compress(self.network.kinds or (), self.network.moving))

    @property
    def reference_lattice(self) -> ContactLattice:
        """The lattice of contacts, in reduced units."""
        return self._lattice

    @property
    def scales(self) -> Units:
        """Length (m), stiffness (N/m) and mass (kg) of the reduced units."""
        return self.network.scales

    @property
    def unit_length(self) -> float:
        """Unit of length, m."""
        return self.scales.length

    @property
    def velocity_scale(self) -> Array:
        """Unit of velocity, m/s."""
        return np.asarray(self.scales.velocity)

    @cached_property
    def elastic_tensor(self) -> Array:
        """Elastic tensor of the periods in Voigt order, (n, n), with inner motions relaxed.

        It is in N where the network repeats along a line, whatever its width; in Pa where it does so in a plane, the force
        per length over one diameter, however thick the network is; in Pa in space.
        """
        unit = {1: self.scales.force, 2: self.scales.modulus, 3: self.scales.modulus}[self._lattice.periods]
        return unit * self._lattice.elastic_tensor()

    @property
    def has_cubic_axes(self) -> bool:
        """Whether the elastic tensor is that of a square or cube with edges along x, y, z, to rounding."""
        return is_cubic(self.elastic_tensor)

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities, m/s, and unit displacements of long waves, see :meth:`State.polarised_waves`."""
        velocities, vectors = self._lattice.sound_velocities(direction)
        return velocities * self.scales.velocity, vectors

    @property
    def twist_velocity(self) -> float | None:
        """Velocity of the wave in which the balls of a straight chain turn about it, m/s; None if they do not."""
        lattice = self._lattice
        if not lattice.runs_twist:
            return None
        torsion = np.broadcast_to(lattice.torsion, lattice.stiffness.shape) * lattice.stiffness
        if not np.all(torsion):
            return 0.0
        # a cell of springs in a row, and of moments of inertia
        inertia = float(lattice.masses @ lattice.gyration**2)
        return float(lattice.measure / np.sqrt(np.sum(1.0 / torsion) * inertia) * self.scales.velocity)


class NetworkStates(State):
    """The states at several loads of what has a network at each, as a crystal has: ``source[i]`` is that at one load."""

    name = "network"
    has_one_lattice = False

    def __init__(self, source: Any) -> None:
        self.source, self.warnings = source, tuple(source.warnings)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the load."""
        return tuple(self.source.shape)

    @cached_property
    def _states(self) -> list[State]:
        each = [self.source[at] for at in np.ndindex(self.shape)] if self.shape else [self.source]
        return [as_state(one) for one in each]

    def _stack(self, find: Callable[[State], Any]) -> Array:
        """Return what ``find`` finds of the state at each load, with the shape of the load in front."""
        values = np.array([find(one) for one in self._states])
        return values.reshape(*self.shape, *values.shape[1:])

    def __getitem__(self, index: Any) -> State:
        """Select some of the loads, by an index as for arrays."""
        return as_state(self.source[index])

    @property
    def network(self) -> ContactNetwork:
        """The network at the only load; :class:`~granphon.base.errors.InputError` for several, each with its own."""
        return given_network(self.source)

    def contact_lattice(self) -> ContactLattice:
        """Return the lattice at the only load; :class:`~granphon.base.errors.InputError` for several, each with its own."""
        given_network(self.source)
        return self.reference_lattice

    @property
    def reference_lattice(self) -> ContactLattice:
        """The lattice at the first load, in reduced units."""
        return self._states[0].reference_lattice

    @property
    def scales(self) -> Units:
        """An error, as each load has units of its own."""
        return given_network(self.source).scales

    @property
    def unit_length(self) -> float:
        """Unit of length, m; :class:`~granphon.base.errors.InputError` if it is not the same at all loads."""
        found = self._stack(lambda one: one.unit_length)
        if np.ptp(found) > 0.0:
            what = "the balls are not as far apart at all loads"
            raise InputError(message(what, "Wave numbers are in units of their distance", "Take one load, as state[0]"))
        return float(np.ravel(found)[0])

    @property
    def velocity_scale(self) -> Array:
        """Unit of velocity at each load, m/s."""
        return self._stack(lambda one: one.velocity_scale)

    @cached_property
    def elastic_tensor(self) -> Array:
        """Elastic tensor, see :attr:`NetworkState.elastic_tensor`."""
        return self._stack(lambda one: one.elastic_tensor)

    @property
    def has_cubic_axes(self) -> bool:
        """Whether the symmetry is that of a square or cube at all loads."""
        return all(one.has_cubic_axes for one in self._states)

    @property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions, at all loads."""
        return all(one.is_isotropic for one in self._states)

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities, m/s, and unit displacements of long waves, see :meth:`State.polarised_waves`."""
        found = [one.polarised_waves(direction) for one in self._states]
        velocities, vectors = (np.array(values) for values in zip(*found, strict=True))
        return velocities.reshape(*self.shape, *velocities.shape[1:]), vectors.reshape(*self.shape, *vectors.shape[1:])

    @property
    def twist_velocity(self) -> Array | None:
        """Velocity of the twist wave at each load, m/s; None if balls do not turn about their chain."""
        return None if self._states[0].twist_velocity is None else self._stack(lambda one: one.twist_velocity)


def as_state(source: Any) -> State:
    """Return ``source``, the argument of a public call, as a state: itself, or that of its network, or of those it has.

    Raises :class:`~granphon.base.errors.InputError` for something that has no network, and for a network without periods.
    """
    if isinstance(source, NetworkStates) and source.is_single:
        return source._states[0]
    if isinstance(source, State):
        return source
    if not getattr(source, "is_single", True):
        return NetworkStates(source)
    warnings = getattr(source, "warnings", None)
    return NetworkState(given_network(source), None if warnings is None else tuple(warnings))


def given_state(state: Any) -> ContactState:
    """Return ``state``, the argument of a public function; raises :class:`InputError` if it is not a ContactState."""
    if isinstance(state, NetworkStates):
        given_network(state.source)  # an error: it has several loads
    if not isinstance(state, ContactState):
        refuse_unpressed(state)
        why = "It needs the contact law of a packing" if isinstance(state, NetworkState | ContactNetwork) else ""
        mend = "Give a ContactState, as medium.at_force gives it"
        raise InputError(message(f"state is {brief(getattr(state, 'network', state))}", why, mend))
    return state
