"""How a lattice answers the contacts of a cluster of its balls: the Green's function that a cluster
of them sees.

The balls have deviations x of their diameters, and t = (x_i + x_j)/2 is the overlap that a contact
would have gained if no ball moved. The balls of a lattice with one stiffness move so that the
elongations e = P t, P = C D^-1 C^T K being the projection on what motions can do
(:mod:`granphon.dynamics.local_field`). What is left, s = (1 - P) t, is the misfit of each contact.
A further tension phi of the contacts of a cluster takes e = P phi/k off their overlaps. So four
tables hold all that a cluster needs to know of the infinite lattice: P between its contacts, what
each ball adds to s, the covariance of s over all balls, and that of P phi for independent tensions
of all contacts outside the cluster.

All are means over the Brillouin zone of bounded functions, found on uniform grids half a step off
Gamma. On each P is a projection to rounding. Such a grid favours some directions by a part that
falls as its spacing to the power of the number of periods, as the functions depend on direction at
Gamma; two grids together leave that part out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.results import read_only
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.zone_quadrature import grid_zone

#: most contacts of a cluster: the work for one grows as their cube
_MOST_CONTACTS = 100
#: points along each period of the two grids over the zone, on a line, in the plane and in space
_POINTS = ((64, 96), (64, 96), (20, 30))
#: number of wave vectors that are worked on at a time
_PART = 2**12

#: a ball by its index in the cell and its whole cells from the middle
_Place = tuple[int, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class ClusterResponse:
    """A cluster in the effective lattice, in units of the diameter and the stiffness of the
    lattice.

    Attributes
    ----------
    balls : number of balls.
    response : (n_c, n_c) P, elongations of the contacts under unit tensions of each.
    influence : (n_c, n_x) what a unit deviation of each ball of the cluster, and then of those that
        touch it, adds to s.
    misfit : (n_c, n_c) covariance of s if the deviations of all balls of the lattice have the
        variance one.
    remote : (n_c, n_c) covariance of P phi for phi of the variance one at every contact outside the
        cluster.
    central : (n_c,) whether a contact is one of the ball in the middle.
    """

    balls: int
    response: Array
    influence: Array
    misfit: Array
    remote: Array
    central: NDArray[np.bool_]

    @property
    def is_fixed(self) -> bool:
        """Whether no misfit is left anywhere: contacts that all carry one force, as on a chain."""
        return float(np.max(np.diag(self.misfit))) < 1e-3


def cluster_sizes(lattice: Lattice) -> list[int]:
    """Return the numbers of balls of the clusters of a lattice, in ascending order: shell after
    shell around one ball.
    """
    return [len(balls) for balls in _grow(lattice)]


@lru_cache(maxsize=32)
def cluster_response(
    lattice: Lattice, mindlin_ratio: float, balls: int | None = None, bending: float = 0.0
) -> ClusterResponse:
    """Find the response of a lattice to a cluster of its ``balls``; None is the ball in the middle
    and those that touch it.

    ``bending`` is the stiffness of a contact against rolling, over k d^2.

    Raises :class:`~granphon.base.errors.InputError` for a number of balls that no shell completes,
    and
    :class:`~granphon.base.errors.MechanismError` if the lattice has a motion that costs no energy.
    """
    clusters = _grow(lattice)
    sizes = [len(cluster) for cluster in clusters]
    if balls is not None and balls not in sizes:
        listed = " or ".join(map(str, sizes))
        raise InputError(
            f"no shell of the {lattice.name} lattice completes {balls} balls", mend=f"Give {listed}"
        )
    medium = ContactLattice.of(lattice, mindlin_ratio, bending=bending)
    medium.require_rigid()
    cluster = clusters[0 if balls is None else sizes.index(balls)]
    near = [*cluster, *_touching(lattice, cluster)]
    table = lattice.contacts
    contacts = _inside(lattice, cluster)
    periods = lattice.periods
    rows = np.array([row for row, _, _ in contacts])
    cells = np.array([cell for _, (_, cell), _ in contacts])
    ends = lattice.positions[:, :periods]
    middles = (
        cells @ lattice.vectors[:, :periods]
        + (ends[table.i] + 0.5 * table.vector[:, :periods])[rows]
    )
    kind_of = np.array([ball for ball, _ in near])
    sites = np.array([cell for _, cell in near]) @ lattice.vectors[:, :periods] + ends[kind_of]
    n = len(contacts)
    kinds = range(len(table))
    response, squared, misfit = np.zeros((3, n, n))
    influence = np.zeros((n, len(near)))
    # wave vectors (n_q, p) of two grids half a step off Gamma, and weights, in parts; q stands for
    # -q too
    coarse, fine = _POINTS[periods - 1]
    share = fine**periods / (fine**periods - coarse**periods)
    parts = list[tuple[Array, Array]]()
    for points, weight in ((coarse, 1.0 - share), (fine, share)):
        grid, counts = grid_zone(medium.reciprocal, points)
        several = -(-len(grid) // _PART)
        every = weight * counts / points**periods
        parts += zip(np.array_split(grid, several), np.array_split(every, several), strict=True)
    for q, weights in parts:
        factor = np.linalg.qr(medium.compatibility(q))[0][:, : len(table)]
        whole = factor @ factor.conj().swapaxes(1, 2)
        # the rows of a contact have the phase of its middle, and deviations that of their ball
        deviations = np.zeros((len(q), len(table), lattice.n_balls), complex)
        half = 0.5 * np.exp(-0.5j * (q @ table.vector[:, :periods].T))
        for kind in kinds:
            deviations[:, kind, table.i[kind]] += half[:, kind]
            deviations[:, kind, table.j[kind]] += half[:, kind].conj()
        left = deviations - whole @ deviations
        there = weights[:, None] * np.exp(1j * (q @ middles.T))
        here = np.exp(-1j * (q @ middles.T))
        at = np.exp(-1j * (q @ sites.T))
        for total, symbol, columns, phase in (
            (response, whole, rows, here),
            (squared, whole @ whole.conj().swapaxes(1, 2), rows, here),
            (misfit, left @ left.conj().swapaxes(1, 2), rows, here),
            (influence, left, kind_of, at),
        ):
            for kind in kinds:
                own = rows == kind
                total[own] += (there[:, own].T @ (symbol[:, kind, columns] * phase)).real
    response, squared, misfit = (0.5 * (whole + whole.T) for whole in (response, squared, misfit))
    central = np.array([cluster[0] in ends for _, *ends in contacts])
    return ClusterResponse(
        len(cluster),
        read_only(response),
        read_only(influence),
        read_only(misfit),
        read_only(squared - response @ response),
        central,
    )


# -- which balls and contacts ----------------------------------------------------------------------


def _grow(lattice: Lattice) -> list[list[_Place]]:
    """Find the balls of each cluster, the middle first: that with its neighbours, then with theirs,
    and so on.
    """
    cluster: list[_Place] = [(0, (0,) * lattice.periods)]
    found: list[list[_Place]] = []
    while True:
        cluster = [*cluster, *_touching(lattice, cluster)]
        if (found and len(_inside(lattice, cluster)) > _MOST_CONTACTS) or len(found) == 3:
            return found
        found.append(cluster)


def _touching(lattice: Lattice, cluster: list[_Place]) -> list[_Place]:
    """Find the balls outside a cluster that touch it."""
    table = lattice.contacts
    found = dict.fromkeys(cluster)
    for ball, cell in cluster:
        for i, j, shift in zip(table.i.tolist(), table.j.tolist(), table.shift, strict=True):
            for here, there, step in ((i, j, shift), (j, i, -shift)):
                if here == ball:
                    found[there, tuple((np.array(cell) + step).tolist())] = None
    return list(found)[len(cluster) :]


def _inside(lattice: Lattice, cluster: list[_Place]) -> list[tuple[int, _Place, _Place]]:
    """Find the contacts between balls of a cluster, each as its row of the table and its two
    balls.
    """
    table = lattice.contacts
    balls = set(cluster)
    found: list[tuple[int, _Place, _Place]] = [
        (
            row,
            (ball, cell),
            (int(table.j[row]), tuple((np.array(cell) + table.shift[row]).tolist())),
        )
        for ball, cell in cluster
        for row in np.flatnonzero(table.i == ball).tolist()
    ]
    return [one for one in found if one[2] in balls]
