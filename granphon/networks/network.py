"""A finite network of contacts: balls, and springs between those that touch, in SI units.

A network comes from a simulated sample, from ``ase.Atoms`` with a calculator, from a lattice, or from a program of discrete
elements. It need not have any order. Waves in it are found by :class:`granphon.waves.waves.Waves`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import Lattice
from granphon.balls.motions import Motions, allowed_motions, select_motions
from granphon.base.errors import InputError, message
from granphon.base.results import Result, read_only
from granphon.base.scales import Units

if TYPE_CHECKING:
    from granphon.dynamics.compatibility import Compatibility

__all__ = ["ContactNetwork"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: deviation of the length of a normal from one that is put down to rounding in a file
_UNIT = 1e-6
#: fields with one number for each ball, and with one for each contact, which are above zero, or zero or above
_BALLS = ("radii", "masses", "inertias")
_SPRINGS = ("shear_stiffness", "torsion_stiffness", "bending_stiffness")


@dataclass(frozen=True, eq=False, repr=False)
class ContactNetwork(Result):
    """Balls and the contacts between them; SI units.

    Attributes
    ----------
    cell : (3, 3) vectors of the periodic cell as rows, m; zero along axes without a period.
    pbc : (3,) whether the network repeats along each vector of the cell.
    positions : (n, 3) centres, m. Balls on a line lie along x, balls of a plane in the xy plane.
    radii : (n,) m.
    masses : (n,) kg. A mass of infinity is a body that does not move, such as a wall.
    inertias : (n,) moments of inertia about a diameter, kg m^2.
    i, j : (n_c,) indices of the two balls of each contact.
    shift : (n_c, 3) whole cells by which ball j is displaced.
    normal : (n_c, 3) unit vectors from i to j along which contacts are compressed.
    normal_force : (n_c,) compressive forces, N, zero or above.
    normal_stiffness : (n_c,) N/m, above zero.
    shear_stiffness : (n_c,) N/m, zero where a contact does not resist slip.
    torsion_stiffness, bending_stiffness : (n_c,) resistance against twist and against rolling, N m.
    arm_i, arm_j : (n_c,) distances from the two centres to the contact, m.
    motions : "longitudinal", "in_plane", "out_of_plane" or "all": the motions of each ball. Balls rotate only if some
        contact resists it.
    dimension : 1, 2 or 3 for balls on a line, in a plane, in space.
    prestress : whether static forces act on displacements across contacts, with the stiffness -f/r, where r is the
        distance of the centres.
    lattice, shape : the lattice and the numbers of cells (L1, ..., Lp) of an array whose balls come in the order of its
        cells, ball by ball of each cell; None for a network of another kind.

    Raises
    ------
    InputError : arrays of different lengths, a contact that names a ball that is not there, a force that pulls, a number
        that is not finite or out of range, a normal whose length is not one.
    """

    units = {
        "cell": "m", "positions": "m", "radii": "m", "masses": "kg", "inertias": "kg m^2", "normal_force": "N",
        "normal_stiffness": "N/m", "shear_stiffness": "N/m", "torsion_stiffness": "N m", "bending_stiffness": "N m",
        "arm_i": "m", "arm_j": "m",
    }  # fmt: skip
    shapes = {
        "cell": "3 3", "positions": "n 3", "radii": "n", "masses": "n", "inertias": "n", "i": "c", "j": "c", "shift": "c 3",
        "normal": "c 3", "normal_force": "c", "normal_stiffness": "c", "shear_stiffness": "c", "torsion_stiffness": "c",
        "bending_stiffness": "c", "arm_i": "c", "arm_j": "c",
    }  # fmt: skip

    cell: Array
    pbc: tuple[bool, bool, bool]
    positions: Array
    radii: Array
    masses: Array
    inertias: Array
    i: Index
    j: Index
    shift: Index
    normal: Array
    normal_force: Array
    normal_stiffness: Array
    shear_stiffness: Array
    torsion_stiffness: Array
    bending_stiffness: Array
    arm_i: Array
    arm_j: Array
    motions: str = "all"
    dimension: int = 3
    prestress: bool = False
    lattice: Lattice | None = None
    shape: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        for name in self.shapes:
            whole = name in ("i", "j", "shift")
            try:
                values = np.array(getattr(self, name), np.intp if whole else np.float64)
            except (TypeError, ValueError):
                raise InputError(message(f"{name} of the network does not hold numbers")) from None
            object.__setattr__(self, name, read_only(values))
        object.__setattr__(self, "pbc", tuple(bool(one) for one in self.pbc))
        super().__post_init__()
        self.check()

    def check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for what the class does not allow."""
        super().check()
        if self.motions not in (allowed := allowed_motions(self.dimension)):
            raise InputError(
                message(
                    f"a network in {self.dimension} dimensions has no motions {self.motions!r}",
                    mend="Use " + ", ".join(allowed),
                )
            )
        self._check_balls()
        self._check_contacts()

    def _check_balls(self) -> None:
        self._require("positions", np.all(np.isfinite(self.positions), axis=1), "ball", "is at a place that is not finite")
        for name in _BALLS:
            values = getattr(self, name)
            self._require(name, (values > 0.0) & ~np.isnan(values), "ball", f"has {name} that are not above zero")
        for axis, periodic in enumerate(self.pbc):
            if periodic and not (np.all(np.isfinite(self.cell[axis])) and np.any(self.cell[axis])):
                raise InputError(message(f"vector {axis} of the cell is {self.cell[axis].tolist()} m, and periodic"))

    def _check_contacts(self) -> None:
        count = len(self.positions)
        for name in ("i", "j"):
            values = getattr(self, name)
            there = (values >= 0) & (values < count)
            self._require(name, there, "contact", f"names a ball that is not there; balls are 0 to {count - 1}")
        moved = np.any(self.shift[:, [not one for one in self.pbc]], axis=1)
        self._require("shift", ~moved, "contact", "crosses a side of the cell that is not periodic")
        alone = (self.i == self.j) & ~np.any(self.shift, axis=1)
        self._require("i", ~alone, "contact", "joins a ball with itself")
        size = np.linalg.norm(self.normal, axis=1)
        self._require("normal", np.abs(size - 1.0) <= _UNIT, "contact", "has a normal whose length is not one")
        for name, low in [("normal_force", False), ("normal_stiffness", True), *[(one, False) for one in _SPRINGS]]:
            values = getattr(self, name)
            inside = np.isfinite(values) & ((values > 0.0) if low else (values >= 0.0))
            pulls = "; forces that pull are not of elastic balls" if name == "normal_force" else ""
            what = "above zero" if low else "zero or above"
            self._require(name, inside, "contact", f"has a {name} that is not {what}{pulls}")
        for name in ("arm_i", "arm_j"):
            self._require(name, np.isfinite(getattr(self, name)), "contact", f"has an {name} that is not finite")

    def _require(self, name: str, fine: Any, what: str, wrong: str) -> None:
        """Raise :class:`InputError` if a ball or contact is not ``fine``; the message names the first, and how many."""
        if not np.all(fine):
            bad = np.flatnonzero(~np.asarray(fine))
            value = np.asarray(getattr(self, name))[bad[0]]
            more = f" ({bad.size} in all)" if bad.size > 1 else ""
            raise InputError(message(f"{what} {bad[0]} of the network {wrong}: {name} = {np.array2string(value)}{more}"))

    # -- what it is -------------------------------------------------------------------------------------------------

    @property
    def n_balls(self) -> int:
        """Number of balls."""
        return len(self.positions)

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return len(self.i)

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """(n,) whether each ball moves: its mass is not infinite."""
        found: NDArray[np.bool_] = read_only(np.isfinite(self.masses))
        return found

    @cached_property
    def ball_motions(self) -> Motions:
        """The motions of each ball, without rotations if no contact resists them."""
        among = allowed_motions(self.dimension)[self.motions]
        return select_motions(self.shear_stiffness, self.torsion_stiffness, self.bending_stiffness, among)

    @cached_property
    def vector(self) -> Array:
        """(n_c, 3) from the centre of ball i to that of ball j, m."""
        return read_only(self.positions[self.j] + self.shift @ self.cell - self.positions[self.i])

    @property
    def coordination(self) -> float:
        """Mean number of contacts of a ball."""
        return 2.0 * self.n_contacts / self.n_balls

    # -- where it comes from ----------------------------------------------------------------------------------------

    @classmethod
    def of(cls, crystal: Compatibility, units: Units, normal_force: Any = 0.0, radii: Any = 0.5, **more: Any) -> Self:
        """Return the network of balls and contacts of one cell of ``crystal``, which is in reduced units.

        Parameters
        ----------
        crystal : table of contacts, stiffnesses, masses, motions, in units of d, k and M.
        units : the scales d (m), k (N/m) and M (kg).
        normal_force : (n_c,) forces, k d.
        radii : (n,) d.
        more : further fields of the network.
        """
        table, d, k = crystal.contacts, units.length, units.stiffness
        p, dimension, count = crystal.periods, crystal.dimension, len(crystal.contacts)
        cell, positions, normal, shift = (
            np.zeros((3, 3)),
            np.zeros((crystal.n_balls, 3)),
            np.zeros((count, 3)),
            np.zeros((count, 3), int),
        )
        cell[:p, :dimension] = d * crystal.cell
        positions[:, :dimension] = d * crystal.positions
        normal[:, : table.normal.shape[1]], shift[:, :p] = table.normal, table.shift
        masses = units.mass * crystal.masses
        spring = k * crystal.stiffness
        return cls(
            cell=cell, pbc=(p > 0, p > 1, p > 2), positions=positions, radii=d * np.broadcast_to(radii, crystal.n_balls),
            masses=masses, inertias=masses * (d * crystal.gyration) ** 2, i=table.i, j=table.j, shift=shift, normal=normal,
            normal_force=k * d * np.broadcast_to(normal_force, count), normal_stiffness=spring,
            shear_stiffness=crystal.mindlin_ratio * spring, torsion_stiffness=crystal.torsion * d * d * spring,
            bending_stiffness=crystal.bending * d * d * spring, arm_i=d * table.arm_i, arm_j=d * table.arm_j,
            **{"motions": crystal.named_motions.name, "dimension": dimension, "prestress": crystal.is_prestressed, **more},
        )  # fmt: skip

    def repeat(self, shape: tuple[int, ...]) -> Self:
        """Return the network of ``shape`` (L1, ..., Lp) cells of this one, one number for each period.

        Balls come in the order of cells, ball by ball of each cell, with the last period fastest.
        """
        axes = [axis for axis in range(3) if self.pbc[axis]]
        if len(shape) != len(axes) or min(shape, default=1) < 1:
            raise InputError(message(f"the shape {tuple(shape)} is not {len(axes)} numbers of cells, 1 or more"))
        full = np.ones(3, int)
        full[axes] = shape
        cells = np.stack(np.meshgrid(*map(np.arange, full), indexing="ij"), axis=-1).reshape(-1, 3)
        n, count = self.n_balls, len(cells)
        steps = cells[:, None] + self.shift  # (cells, n_c, 3) cell of ball j
        there, wrapped = np.mod(steps, full), np.floor_divide(steps, full)
        number = np.ravel_multi_index(tuple(np.moveaxis(there, -1, 0)), tuple(full))
        balls: dict[str, Any] = {name: np.tile(getattr(self, name), count) for name in _BALLS}
        contacts: dict[str, Any] = {
            name: np.tile(getattr(self, name), (count, *(1,) * (getattr(self, name).ndim - 1)))
            for name in ("normal", "normal_force", "normal_stiffness", *_SPRINGS, "arm_i", "arm_j")
        }
        contacts = {name: values.reshape(-1, *np.shape(getattr(self, name))[1:]) for name, values in contacts.items()}
        return replace(
            self, cell=self.cell * full[:, None],
            positions=(np.asarray(cells @ self.cell)[:, None] + self.positions).reshape(-1, 3), **balls,
            i=(n * np.arange(count)[:, None] + self.i).ravel(), j=(n * number + self.j).ravel(),
            shift=wrapped.reshape(-1, 3), shape=tuple(map(int, shape)) if self.lattice is not None else None, **contacts,
        )  # fmt: skip
