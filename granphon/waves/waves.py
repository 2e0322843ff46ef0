"""Waves in a finite network of contacts: the entry to densities of states, spectral functions, modes and pulses."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from granphon.base.errors import InputError, brief, message
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator

__all__ = ["Waves"]


class Waves:
    """The waves of a network of contacts.

    Parameters
    ----------
    source : a :class:`~granphon.networks.network.ContactNetwork`; a simulated sample; or ``ase.Atoms`` with a
        :class:`~granphon.phonons.calculator.HertzMindlin`.

    Raises :class:`~granphon.base.errors.InputError` for something else.
    """

    def __init__(self, source: Any) -> None:
        self.network = _find_network(source)

    @cached_property
    def operator(self) -> WaveOperator:
        """D of the network as a linear operator, (rad/s)^2."""
        return WaveOperator(self.network)


def _find_network(source: Any) -> ContactNetwork:
    """Return the network of a source, which is one, has one, or is Atoms whose calculator knows it."""
    if isinstance(source, ContactNetwork):
        return source
    found = getattr(source, "network", None)
    if isinstance(found, ContactNetwork):
        return found
    find = getattr(getattr(source, "calc", None), "contact_network", None)
    if find is not None:
        network: ContactNetwork = find(source)
        return network
    if hasattr(source, "contact_network") and hasattr(source, "packing"):
        several = "" if not source.samples else ", or one of its samples, as in gp.Waves(state.samples[0])"
        raise InputError(
            message(
                "a state is of a lattice without end",
                "Waves are of an array of some cells",
                f"Give gp.ContactNetwork.from_state(state, shape={(24,) * source.packing.structure.periods}){several}",
            )
        )
    raise InputError(
        message(
            f"there is no network of contacts in {brief(source)}",
            mend="Give a ContactNetwork, a sample of a simulation, or Atoms with a HertzMindlin",
        )
    )
