"""Balls, walls and a cell that touch: what comes to rest under a load.

An assembly is a list of contacts between bodies. Its bodies are the balls that move, each with a
displacement u; then the walls, each of which moves along one line; and last one body for all that
is held, as a floor is. The cell strains uniformly. A contact has the vector v from body i to body j
at touch. With small displacements and a small strain E,

    w = u_j - u_i + E v,    overlap = o - n.w,    n = v/|v|

where o is the overlap of the bodies on their sites: zero if the bodies just touch there. In exact
directions the contact turns with its balls: n = (v + w)/|v + w|, and the overlap is o - (|v + w| -
|v|). A contact with a flat wall does not turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_laws import PairLaw
from granphon.base.arrays import Array, Flags, Index
from granphon.contacts.grid import Grid
from granphon.contacts.laws import ContactLaws

#: a component of a unit normal up to this counts as zero, and so does an overlap up to this part
#: of the largest overlap
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Assembly:
    """The contacts of balls, walls and a cell, from touch on; SI units.

    Attributes
    ----------
    n_balls : number n of the balls that move, which are the first bodies.
    i, j : (n_c,) numbers of the two bodies of each contact; n to n + k - 1 are walls, and n + k is
        what is held.
    vector : (n_c, 3) from body i to body j, at touch, m; with a wall, from the centre of the ball
        to the wall.
    is_flat : (n_c,) whether the contact is with a flat wall, and does not turn.
    offset : (n_c,) overlaps on the sites, m.
    laws : the laws of the contacts.
    cell : (p, p) the periods, m, along the first p axes.
    dimension : number d of axes along which balls move.
    directions : (k, d) unit vectors along which the walls move.
    wall_balls : (k,) number of balls that lean on each wall or ride with the wall.
    grid : the contacts kind by kind, if they are those of an array of equal cells without walls;
        None otherwise.
    """

    n_balls: int
    i: NDArray[np.int64]
    j: NDArray[np.int64]
    vector: Array
    is_flat: Flags
    offset: Array
    laws: ContactLaws
    cell: Array
    dimension: int
    directions: Array
    wall_balls: Array
    grid: Grid | None = None

    def __post_init__(self) -> None:
        """Replace ``i`` and ``j`` by read-only views. Those of a grid are read-only: for arrays
        that can be written, loops would be compiled a second time.
        """
        for name in ("i", "j"):
            numbers = getattr(self, name).view()
            numbers.flags.writeable = False
            object.__setattr__(self, name, numbers)  # the dataclass is frozen

    @property
    def n_contacts(self) -> int:
        """Number n_c of contacts."""
        return len(self.i)

    @property
    def n_walls(self) -> int:
        """Number k of walls that move."""
        return len(self.directions)

    @property
    def n_bodies(self) -> int:
        """Number n + k + 1 of bodies: n balls, k walls, and one for all that is held."""
        return self.n_balls + self.n_walls + 1

    @property
    def periods(self) -> int:
        """Number p of periods of the cell."""
        return len(self.cell)

    @cached_property
    def measure(self) -> float:
        """Length, area or volume of the cell; 1 without a period."""
        return abs(float(np.linalg.det(self.cell))) if self.periods else 1.0

    @cached_property
    def distance(self) -> Array:
        """(n_c,) distances of the bodies at touch, m."""
        return np.asarray(np.sqrt(np.einsum("ca,ca->c", self.vector, self.vector)))

    @property
    def mean_distance(self) -> float:
        """Mean distance of the bodies at touch, m."""
        return float(np.mean(self.distance))

    @cached_property
    def normal(self) -> Array:
        """(n_c, 3) unit vectors from body i to body j at touch."""
        return np.asarray(self.vector / self.distance[:, None])

    @cached_property
    def has_offsets(self) -> bool:
        """Whether some bodies overlap, or are apart, on the sites."""
        return bool(np.any(self.offset))

    @cached_property
    def standing(self) -> set[int]:
        """Numbers of free strains of the cell with which the assembly stands while all contacts
        touch: all motions but those of the whole cost energy.

        The set is empty at first. A search for motions that cost no energy adds to it the number of
        free strains with which it has found none.
        """
        return set()

    @cached_property
    def is_between_balls(self) -> Flags:
        """(n_c,) whether both bodies of each contact are balls that move."""
        return np.asarray(np.maximum(self.i, self.j) < self.n_balls)

    @cached_property
    def free_axes(self) -> list[int]:
        """The axes along which no wall and nothing held resists a motion of all balls together. If
        no ball moves by itself, there are none.
        """
        if not self.n_balls:
            return []
        has_component = np.abs(self.normal[~self.is_between_balls]) > ROUNDING
        is_resisted = np.any(has_component, axis=0)
        return [axis for axis in range(self.dimension) if not is_resisted[axis]]

    @cached_property
    def n_touching(self) -> Index:
        """(n,) number of all contacts of each ball, as :meth:`count_contacts` counts them."""
        return self.count_contacts(np.ones(self.n_contacts, bool))

    def count_contacts(self, is_chosen: Flags) -> Index:
        """Return the number (n,) of contacts of each ball among those where ``is_chosen`` (n_c,) is
        true. A contact of a ball with its own image holds no ball, and is not counted.
        """
        is_counted = is_chosen & (self.i != self.j)
        ends = np.concatenate([self.i[is_counted], self.j[is_counted]])
        return np.bincount(ends, minlength=self.n_bodies)[: self.n_balls]

    def find_stress(self, overlap: Array, normal: Array, deformation: Array) -> Array:
        """Return the stress (p, p) on the cell, N, N/m or Pa with one, two or three periods; it is
        below zero where balls are pressed together.

        The stress is minus the symmetric part of the virial over the length, area or volume of the
        cell. Contacts with flat walls do not count in the virial.

        The contacts have the ``overlap`` (n_c,), m, and the ``normal`` (n_c, 3); the matrix
        ``deformation`` F (p, p) takes vectors of the cell at touch to those of the present cell.
        """
        p = self.periods
        forces = self.laws.force(overlap)[:, None] * normal[:, :p]
        virial = forces.T @ np.where(self.is_flat[:, None], 0.0, self.vector[:, :p])
        virial = virial @ deformation.T
        measure = self.measure * float(np.linalg.det(deformation))
        return np.asarray(-0.5 * (virial + virial.T) / measure)

    def make_losses(self) -> Any:
        """Return the sparse matrix L (n_c, n_bodies d), stored by rows. The row of a contact has -n
        at the d columns of body i, and n at those of body j.

        L times the displacements of bodies, m, is the loss n.(u_j - u_i) of the overlap of each
        contact, m, along its normal at touch. The transpose of L times the forces of contacts, N,
        is the force on each body, N. If both bodies are one ball, which touches its own image, the
        entries of the row stand twice at the same columns, and cancel.
        """
        from scipy.sparse import csr_array  # imported here: averages do not need SciPy

        d = self.dimension
        normal = self.normal[:, :d]
        ends = np.stack([self.i, self.j], axis=1)
        columns = d * ends[..., None] + np.arange(d)
        entries = np.stack([-normal, normal], axis=1)
        starts = 2 * d * np.arange(self.n_contacts + 1)
        shape = (self.n_contacts, d * self.n_bodies)
        return csr_array((entries.ravel(), columns.ravel(), starts), shape=shape)

    def cut_out(self, is_chosen: Flags, vector: Array, overlap: Array) -> Assembly:
        """Return the assembly of the balls where ``is_chosen`` (n,) is true; all other bodies are
        held.

        The assembly keeps the contacts of which at least one body is chosen. Its displacements are
        counted from a state in which contacts have the ``vector`` (n_c, 3), m, from body to body
        and the ``overlap`` (n_c,), m.
        """
        count = int(np.count_nonzero(is_chosen))
        # chosen balls are numbered from zero; all other bodies have the number of what is held
        number = np.full(self.n_bodies, count)
        number[: self.n_balls][is_chosen] = np.arange(count)
        i = number[self.i]
        j = number[self.j]
        contacts: Index = np.flatnonzero(np.minimum(i, j) < count)
        return Assembly(
            n_balls=count,
            i=i[contacts],
            j=j[contacts],
            vector=np.ascontiguousarray(vector[contacts]),
            is_flat=self.is_flat[contacts],
            offset=overlap[contacts],
            laws=self.laws.among(contacts),
            cell=np.zeros((0, 0)),
            dimension=self.dimension,
            directions=np.zeros((0, self.dimension)),
            wall_balls=np.zeros(0),
        )


class GridAssembly(Assembly):
    """The contacts of an array of equal cells, which all have one law.

    The arrays over contacts, such as ``i`` and ``vector``, are made from the kinds of contacts of
    the ``grid`` when they are first read.

    Parameters
    ----------
    grid : the contacts, kind by kind.
    offset : (n_c,) overlaps on the sites, m.
    law : the law of all contacts.
    cell : (p, p) the periods, m.
    is_standing : whether it is known that, while all contacts touch, all motions but those of the
        whole cost energy, whichever strains of the cell are free.
    """

    grid: Grid
    law: PairLaw

    def __init__(
        self, grid: Grid, offset: Array, law: PairLaw, cell: Array, is_standing: bool = False
    ) -> None:
        """Keep the grid, and set what follows from it but the arrays over contacts."""
        p = len(cell)
        # attributes of an object of a frozen class are set in its dictionary
        values = {
            "grid": grid,
            "law": law,
            "n_balls": grid.n_balls * grid.n_cells,
            "offset": offset,
            "cell": cell,
            "dimension": p,
            "directions": np.zeros((0, p)),
            "wall_balls": np.zeros(0),
            # from no free strain to all p (p + 1)/2
            "standing": set(range(p * (p + 1) // 2 + 1)) if is_standing else set(),
        }
        vars(self).update(values)

    @property
    def n_contacts(self) -> int:
        """Number n_c of contacts."""
        return len(self.offset)

    @cached_property
    def i(self) -> NDArray[np.int64]:
        """(n_c,) numbers of the balls i of contacts."""
        return self.grid.ends[0]

    @cached_property
    def j(self) -> NDArray[np.int64]:
        """(n_c,) numbers of the balls j of contacts."""
        return self.grid.ends[1]

    @cached_property
    def vector(self) -> Array:
        """(n_c, 3) from ball i to ball j, at touch, m."""
        return np.repeat(self.grid.vector, self.grid.n_cells, axis=0)

    @cached_property
    def normal(self) -> Array:
        """(n_c, 3) unit vectors from ball i to ball j at touch."""
        return np.repeat(self.grid.normal, self.grid.n_cells, axis=0)

    @cached_property
    def distance(self) -> Array:
        """(n_c,) distances of the balls at touch, m."""
        return np.repeat(self.grid.distance, self.grid.n_cells)

    @property
    def mean_distance(self) -> float:
        """Mean distance of the balls at touch, m."""
        return float(np.mean(self.grid.distance))

    @cached_property
    def is_flat(self) -> Flags:
        """(n_c,) false: no contact is with a flat wall."""
        return np.zeros(self.n_contacts, bool)

    @cached_property
    def laws(self) -> ContactLaws:
        """The laws of the contacts."""
        return ContactLaws([(self.law, np.arange(self.n_contacts))], self.n_contacts)

    @cached_property
    def free_axes(self) -> list[int]:
        """The axes along which nothing resists a motion of all balls together: all d axes."""
        return list(range(self.dimension))

    def spell_out(self) -> Assembly:
        """Return an assembly of the same contacts without ``grid``, with all arrays over
        contacts.
        """
        return Assembly(
            n_balls=self.n_balls,
            i=self.i,
            j=self.j,
            vector=self.vector,
            is_flat=self.is_flat,
            offset=self.offset,
            laws=self.laws,
            cell=self.cell,
            dimension=self.dimension,
            directions=self.directions,
            wall_balls=self.wall_balls,
        )
