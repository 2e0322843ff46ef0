"""Cells of crystals and of packings, which stand where a scene has a lattice."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from granphon.balls.lattices import Lattice
from granphon.balls.layers import find_axes
from granphon.base.arrays import Array

if TYPE_CHECKING:
    from granphon.media.crystal import Crystal
    from granphon.networks.network import ContactNetwork


#: balls of a crystal or a packing up to which its states are found when a scene is only checked
QUICK_BALLS = 500


@dataclass(frozen=True)
class CrystalCell(Lattice):
    """The cell of a crystal or a packing, in units of the mean diameter.

    A coordinate of ``sites`` is a fraction of the vector of the cell, for each period; the
    coordinates across the periods are in mean diameters. A cluster without periods is put into a
    cell along x that is so long that the cluster does not touch its images.
    """

    #: length of the longest contact, in mean diameters
    reach: float = field(default=1.0, compare=False)
    #: number of axes along which a pressure acts: the periods of the crystal, and the axes across
    #: which it was cut; 1 of a cluster, which has neither
    pressed_axes: int = field(default=1, compare=False)

    def __post_init__(self) -> None:
        """Skip the checks of :class:`~granphon.balls.lattices.Lattice`, which are those of equal
        balls that touch at one spacing; the crystal or the network was checked when it was made.
        Cell and sites are tuples already.
        """

    @classmethod
    def of(cls, crystal: Crystal, diameter: float) -> CrystalCell:
        """Return the cell of a crystal for a mean ``diameter``, m. Its attribute ``contacts`` is
        the table of the crystal, in m.
        """
        lengths = np.linalg.norm(crystal.contacts.vector, axis=1)
        longest_contact = float(lengths.max(initial=0.0)) / diameter
        vectors, sites = _reduce_cell(crystal.cell, crystal.positions, crystal.radii, diameter)
        cell = cls(
            name=crystal.name,
            cell=vectors,
            sites=sites,
            reach=longest_contact,
            pressed_axes=max(1, crystal.periods + len(crystal.faces)),
        )
        # the value of the cached property of Lattice, which would search for contacts of equal
        # balls; the lengths of this table are in m
        cell.__dict__["contacts"] = crystal.contacts
        return cell

    @classmethod
    def of_network(cls, network: ContactNetwork, diameter: float) -> CrystalCell:
        """Return the cell of the balls of a network that move, for a mean ``diameter``, m.

        The network is turned as for its contact lattice: its first period is along x, and the
        second in the xy plane.
        """
        d = network.dimension
        is_moving = network.moving
        periods = network.cell[np.flatnonzero(network.pbc), :d]
        turn = find_axes(periods) if len(periods) else np.eye(d)
        distances = network.distance[np.isfinite(network.distance)]  # between balls, not to walls
        longest_contact = float(distances.max(initial=0.0)) / diameter
        vectors, sites = _reduce_cell(
            periods @ turn.T,
            network.positions[is_moving, :d] @ turn.T,
            network.radii[is_moving],
            diameter,
        )
        return cls(
            name="packing",
            cell=vectors,
            sites=sites,
            reach=longest_contact,
            pressed_axes=max(1, sum(network.pbc)),  # 1 of a cluster, which has no periods
        )


def _reduce_cell(
    vectors: Array, positions: Array, radii: Array, diameter: float
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
    """Return the vectors (p, d) of a cell in mean diameters, and the sites (n, d) of its balls.

    ``vectors`` (p, d), along the first p axes, ``positions`` (n, d), ``radii`` (n,) and the mean
    ``diameter`` are in m. The first p coordinates of a site are fractions of the vectors, the
    others mean diameters. A cluster without periods is put into a cell along x.
    """
    sites = positions.copy()
    if not len(vectors):
        # the nearest centres of the cluster and its image are two largest diameters apart
        length = float(np.ptp(sites[:, 0])) + 4.0 * float(np.max(radii))
        vectors = np.eye(sites.shape[1])[:1] * length
    p = len(vectors)
    sites[:, :p] = sites[:, :p] @ np.linalg.inv(vectors[:, :p])
    sites[:, p:] /= diameter
    rows = tuple(map(tuple, (vectors / diameter).tolist()))
    return rows, tuple(map(tuple, sites.tolist()))
