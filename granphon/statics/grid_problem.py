"""A problem of statics on a grid, whose contacts keep the directions of the lattice.

The overlap of a contact is h = y + o - n.(u_j - u_i), with the overlap y that the strain of the
cell makes, which all contacts of a kind share, and the overlap o on the sites. No contact is
spelled out (:mod:`granphon.contacts.grid_loops`).

Lengths are over a power of two near the spread of the overlaps on the sites, forces over those of
Hertz's law for this overlap.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.contacts import grid_loops
from granphon.contacts.assembly import ROUNDING, GridAssembly
from granphon.contacts.grid import Grid
from granphon.statics.configuration import Problem
from granphon.statics.grid_iteration import lay, list_balls
from granphon.statics.options import RestOptions

Values = NDArray[Any]
#: width of diameters that are spread evenly, over the rms of the overlaps on the sites
_WIDTH_OVER_RMS = math.sqrt(24.0)


class Unknowns(NamedTuple):
    """Displacements of balls (f, cells), and strains (s,) of the cell; or the forces on them."""

    balls: Values
    strains: Values


class GridProblem:
    """A ``problem`` on a grid whose contacts have Hertz's law, in units of its own.

    Arrays of contacts are (kinds, cells), and arrays of balls (f, cells), f being the displacements
    of the balls of a cell. Lengths are in the unit ``unit``, forces in the unit ``force_unit``.
    The unknowns of the s strains are lengths, as those of the ``problem``.

    Attributes
    ----------
    problem, grid : the problem in SI units, and the contacts, kind by kind.
    n_fields : number f of displacements of the balls of a cell.
    offset : (kinds, cells) overlaps on the sites.
    given : (kinds,) overlaps that a given strain makes.
    strained : (kinds, s) what contacts lose of their overlaps over each unknown of a strain.
    is_even : whether all kinds have the same ``given`` and ``strained``, to the last digit: then
        all contacts have one common overlap.
    work : (s,) forces of the load on strains.
    load_force : mean force of the contacts under the load, zero where a strain is given.
    pushes : (kinds, f) forces on the balls of a cell by contacts of each kind with a force of one.
    balances : whether contacts with one common overlap leave no force on any ball.
    spread : standard deviation of the overlaps on the sites.
    unit, force_unit : units of lengths, m, and of forces, N.
    has_given_strain : whether the strain of the cell is given, but for shears.
    has_free_strains : whether the cell has unknown strains.
    """

    def __init__(self, problem: Problem) -> None:
        assembly = problem.assembly
        assert isinstance(assembly, GridAssembly)
        assert isinstance(assembly.law, hertz.HertzLaw)
        grid = assembly.grid
        load = problem.load
        self.problem = problem
        self.grid: Grid = grid
        self.n_fields = grid.n_balls * len(grid.shape)
        self.has_given_strain = load.stress is None and load.mean_force is None
        strained, given, self.is_even = _find_common_losses(problem, grid)
        self.strained = strained
        self.has_free_strains = strained.shape[1] > 0
        self.pushes = _find_pushes(grid)
        cancels = np.abs(np.sum(self.pushes, axis=0)) <= ROUNDING * grid.n_kinds
        self.balances = self.is_even and bool(np.all(cancels))
        # in the units of the problem from here on
        offset = assembly.offset.reshape(grid.n_kinds, grid.n_cells)
        spread = float(np.std(offset))
        force = _find_mean_force(problem, grid)
        coefficient = assembly.law.coefficient
        self.unit = _choose_unit(spread, given, float(hertz.overlap_of(force / coefficient)))
        self.force_unit = coefficient * self.unit**hertz.EXPONENT
        # a large array is not copied where the unit is one metre
        self.offset = offset if self.unit == 1.0 else offset / self.unit
        self.spread = spread / self.unit
        self.given = given / self.unit
        self.work = _find_work(problem, strained, grid) / self.force_unit
        self.load_force = force / self.force_unit

    @cached_property
    def weight(self) -> float:
        """Factor from a force on a strain to a force on each contact; zero without unknown
        strains.
        """
        if not self.has_free_strains:
            return 0.0
        return 1.0 / (self.grid.n_cells * float(np.max(np.sum(np.abs(self.strained), axis=0))))

    def needs_more_load(self, options: RestOptions) -> bool:
        """Return whether the search is to begin at rest under a larger load: where balls differ and
        the mean force of the load is below ``options.least_interior_force``.
        """
        if self.has_given_strain or not self.spread:
            return False
        return bool(self.load_force < options.least_interior_force)

    def begins_inside(self, strains: Array, options: RestOptions) -> bool:
        """Return whether the interior-point method is to come before Newton's, which then begins
        near rest. It comes before where balls differ and, in space, the grid is small enough for
        factors. If a strain is given, fewer contacts than the part ``options.closed_part`` must be
        closed on the sites at the ``strains`` (s,) of the start; if not, equal balls must have a
        mean force there in the range of the ``options``.
        """
        # in space the interior-point method takes too many iterations without factors
        if not self.spread or (len(self.grid.shape) == 3 and not is_small(self.grid, options)):
            return False
        common = self.find_common(strains)
        if self.has_given_strain:
            closed_part = np.mean(common[:, None] + self.offset > 0.0)
            return bool(closed_part < options.closed_part)
        force = float(np.mean(hertz.force_of(common)))
        least = options.least_interior_force
        most = options.largest_interior_force
        return bool(least <= force <= most)

    def needs_fine_start(self, options: RestOptions) -> bool:
        """Return whether a search in exact directions is to begin at a rest of this problem that is
        found with the full tolerance: where the places of loose balls depend on that rest, and the
        interior-point method does not lead to it.
        """
        if self.has_given_strain:
            leaves_loose = float(np.mean(self.given)) < options.uncertain_load
        else:
            leaves_loose = self.load_force < options.uncertain_load
        return leaves_loose and not self.begins_inside(self.find_strains(), options)

    def find_strains(self) -> Array:
        """Return the strains (s,) under which equal contacts have the mean force of the load, or
        come nearest to it in overlap; zeros where a strain is given.
        """
        if self.has_given_strain:
            return np.zeros(len(self.work))
        losses = self.given - float(hertz.overlap_of(self.load_force))
        strains, *_ = np.linalg.lstsq(self.strained, losses, rcond=None)
        return np.asarray(strains)

    def find_common(self, strains: Array) -> Array:
        """Return the overlaps (kinds,) that the given strain and ``strains`` (s,) make."""
        return np.asarray(self.given - self.strained @ strains)

    def measure_losses(self, balls: Values) -> Values:
        """Return the losses of overlap (kinds, cells) by displacements ``balls`` (f, cells), in the
        precision of the displacements.
        """
        loss = np.empty(self.offset.shape, balls.dtype)
        grid_loops.measure_losses(self.grid.runs, balls, loss)
        return loss

    def find_overlaps(self, balls: Array, strains: Array) -> Array:
        """Return the overlaps (kinds, cells) at displacements ``balls`` (f, cells) and ``strains``
        (s,).
        """
        overlaps = self.measure_losses(balls)
        np.subtract(self.offset, overlaps, out=overlaps)
        overlaps += self.find_common(strains)[:, None]
        return np.asarray(overlaps)

    def add_losses(self, loss: Values, strains: Array) -> Values:
        """Add to losses of overlap (kinds, cells), in place, those by strains (s,), and return
        them.
        """
        if len(strains):
            loss += (self.strained @ strains)[:, None]
        return loss

    def collect(self, force: Values) -> Values:
        """Return the forces on balls (f, cells) that a ``force`` (kinds, cells) of contacts makes,
        above zero where balls are pushed apart, in the precision of that force.
        """
        on_balls = np.zeros((self.n_fields, self.grid.n_cells), force.dtype)
        grid_loops.add_forces(self.grid.runs, force, on_balls)
        return on_balls

    def find_largest_force(self, on_balls: Values) -> float:
        """Return the size of the largest of the forces (f, cells) on balls."""
        d = len(self.grid.shape)
        forces = on_balls.reshape(-1, d, self.grid.n_cells)
        squares = np.einsum("bac,bac->bc", forces, forces)  # |F|^2 of each ball
        return math.sqrt(float(np.max(squares)))

    def lay(self, displacement: Array) -> Array:
        """Return displacements of balls (n, d), m, in the form of this problem: (f, cells), in its
        unit.
        """
        fields = lay(displacement[..., None], self.grid.n_cells)[:, 0]
        fields /= self.unit
        return fields

    def list_displacements(self, balls: Array) -> Array:
        """Return displacements (f, cells) of this problem as those of a list of balls, (n, d), m,
        less their mean.
        """
        by_ball = list_balls(balls[:, None], len(self.grid.shape))[..., 0]
        return np.asarray(self.unit * (by_ball - np.mean(by_ball, axis=0)))


def is_small(grid: Grid, options: RestOptions) -> bool:
    """Return whether a ``grid`` is small enough for factors."""
    return grid.n_cells * grid.n_balls <= options.most_balls[len(grid.shape)]


def _find_common_losses(problem: Problem, grid: Grid) -> tuple[Array, Array, bool]:
    """Return what the contacts of each kind lose of their overlaps, m, over each unknown of a
    strain, m, (kinds, s); the overlaps (kinds,), m, that the given strain makes; and whether both
    are the same for all kinds.

    Numbers of kinds that are the same but for rounding are made the same to the last digit, so that
    the kinds can be worked on together.
    """
    normal = grid.normal
    # an overlap loses n.E v by a strain E
    strained = np.einsum("ka,sab,kb->ks", normal, problem.unit_strains, grid.vector)
    given = -np.einsum("ka,ab,kb->k", normal, problem.given_strain, grid.vector)
    largest = float(np.max(np.abs(strained), initial=0.0))
    differences = float(np.max(np.ptp(strained, axis=0), initial=0.0))
    is_even = differences <= ROUNDING * largest
    is_even = is_even and float(np.ptp(given)) <= ROUNDING * float(np.max(np.abs(given)))
    if is_even:
        strained[:] = strained[0]
        given[:] = given[0]
    return strained, given, is_even


def _find_pushes(grid: Grid) -> Array:
    """Return the forces (kinds, f) on the balls of a cell by contacts of each kind that all have a
    force of one: the normal n on the second ball of a contact, and -n on the first.
    """
    d = len(grid.shape)
    pushes = np.zeros((grid.n_kinds, grid.n_balls, d))
    kinds = np.arange(grid.n_kinds)
    np.add.at(pushes, (kinds, grid.j), grid.normal[:, :d])
    np.add.at(pushes, (kinds, grid.i), -grid.normal[:, :d])
    return pushes.reshape(grid.n_kinds, -1)


def _choose_unit(spread: float, given: Array, overlap: float) -> float:
    """Return the unit of lengths, m: the power of two that is nearest, on a logarithmic scale, to
    the width of diameters with a ``spread`` of overlaps on the sites, m. Of balls that do not
    differ, it is near the ``overlap``, m, of the mean force of the load, or else near the overlaps
    ``given`` (kinds,), m, that a given strain makes; 1 m where this length is zero or not finite.
    """
    length = _WIDTH_OVER_RMS * spread or overlap or float(np.max(np.abs(given)))
    return 2.0 ** round(math.log2(length)) if 0.0 < length < math.inf else 1.0


def _find_work(problem: Problem, strained: Array, grid: Grid) -> Array:
    """Return the forces (s,), N, of the load on the unknown strains; contacts lose ``strained``
    (kinds, s) of their overlaps over each. Zeros where a strain is given.

    A given mean force acts as the stress that balances contacts which all have this force.
    """
    load = problem.load
    if load.mean_force is not None:
        return np.asarray(-load.mean_force * grid.n_cells * np.sum(strained, axis=0))
    if load.stress is not None:
        return problem.find_work(load.stress)
    return np.zeros(strained.shape[1])


def _find_mean_force(problem: Problem, grid: Grid) -> float:
    """Return the mean force of contacts under a load, N, by the virial where a stress is given;
    zero where a strain is.
    """
    load = problem.load
    if load.mean_force is not None:
        return load.mean_force
    if load.stress is None:
        return 0.0
    pressing = -float(np.trace(load.stress)) * problem.assembly.measure
    return pressing / (grid.n_cells * float(np.sum(grid.distance)))
