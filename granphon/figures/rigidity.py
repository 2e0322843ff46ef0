"""Figures of how rigid packings are: their moduli over the number of their contacts."""

from __future__ import annotations

from collections.abc import Iterable

from granphon.figures.scales import styled_figure

from matplotlib.axes import Axes

from granphon.base.errors import InputError, brief
from granphon.figures.style import BLUE
from granphon.networks.network import ContactNetwork
from granphon.observables.validity import validity
from granphon.observables.velocities import moduli


def plot_rigidity(networks: Iterable[ContactNetwork], ax: Axes | None = None) -> Axes:
    """Draw a point for each of some packings, and return the Axes. Upwards is the ratio of the
    shear to the bulk modulus, Hill's means over directions. To the right is the excess of contacts
    of a ball over the isostatic number, the limit of ``gp.validity(network)["contacts"]``.

    ``networks`` is a list of networks that repeat, or a series of steps of a simulation
    (:meth:`~granphon.ContactNetwork.series`), of which one is held at a time. If ``ax`` is not
    given, a new figure, one column wide, is made.

    Raises :class:`~granphon.base.errors.InputError` without a network, for a network that is in
    no list and for what is no list, and what :func:`granphon.moduli` raises.
    """
    if isinstance(networks, ContactNetwork):
        why = "A point stands for a packing"
        raise InputError("networks is a single network", why, "Give a list of networks")
    if not isinstance(networks, Iterable):
        raise InputError(f"networks is {brief(networks)}", mend="Give a list of networks")
    if ax is None:
        with styled_figure(2.4) as figure:
            return plot_rigidity(networks, figure.subplots())
    excesses = list[float]()
    ratios = list[float]()
    for network in networks:
        contacts = validity(network)["contacts"]
        means = moduli(network).hill
        excesses.append(float(contacts.value - contacts.limit))
        ratios.append(float(means.shear / means.bulk))
    if not ratios:
        raise InputError("there is no network", "A point stands for a packing", "Give networks")
    ax.plot(excesses, ratios, "o", color=BLUE)
    ax.set(
        xlabel="Contacts of a ball above the isostatic number",
        ylabel="Shear over bulk modulus",
    )
    ax.set_ylim(bottom=0.0)
    return ax
