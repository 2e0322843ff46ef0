"""Figures of how rigid packings are: their moduli over the number of their contacts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from granphon.figures.scales import styled_figure

from matplotlib.axes import Axes

from granphon.base.errors import InputError, brief
from granphon.figures.style import BLUE
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.validity import validity
from granphon.observables.velocities import moduli


def plot_rigidity(networks: Iterable[Any], ax: Axes | None = None) -> Axes:
    """Draw a point for each of some packings, and return the Axes. Upwards is the ratio of the
    shear to the bulk modulus, Hill's means over directions. To the right is the excess of contacts
    of a ball over the isostatic number, the limit of ``gp.validity(network)["contacts"]``.

    ``networks`` is a list of networks that repeat, or a series of steps of a simulation, each with
    its network (:meth:`~granphon.ContactNetwork.series`), of which one is held at a time. If ``ax``
    is not given, a new figure, one column wide, is made.

    Raises :class:`~granphon.base.errors.InputError` without a network, for a network that is in
    no list, for what is no list of networks, for a network whose contacts hold no ball, and what
    :func:`granphon.moduli` raises.
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
    for item in networks:
        is_step = isinstance(item, tuple) and len(item) == 2  # of a series: a time step, a network
        network = given_network(item[1] if is_step else item)
        excesses.append(_find_excess(network))
        means = moduli(network).hill
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


def _find_excess(network: ContactNetwork) -> float:
    """Return the number of contacts of a ball less the isostatic number; InputError if contacts
    hold no ball of the network, which then has no such number.
    """
    for check in validity(network).checks:
        if check.name == "contacts":
            return float(check.value - check.limit)
    raise InputError("the contacts of a network hold no ball", mend="Leave the network out")
