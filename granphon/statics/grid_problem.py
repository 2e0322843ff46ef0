"""A problem of statics on a grid, whose contacts keep the directions of the lattice.

The overlap of a contact is h = y + o - n.(u_j - u_i), with y by the strain of the cell, which all
contacts of a kind share, and the overlap o on the sites. No contact is spelled out
(:mod:`granphon.contacts.grid_loops`).

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
    """A problem on a grid whose contacts have Hertz's law, in units of its own.

    Arrays of contacts are (kinds, cells), and arrays of balls (f, cells), f being the displacements
    of the balls of a cell. Lengths are in the unit ``unit``, forces in the unit ``force_unit``.

    Attributes
    ----------
    offset : (kinds, cells) overlaps on the sites.
    given : (kinds,) overlaps that a given strain makes.
    strained : (kinds, s) what contacts lose of their overlaps by unit strains.
    work : (s,) forces of the load on strains.
    spread : standard deviation of the overlaps on the sites.
    unit, force_unit : units of lengths, m, and of forces, N.
    is_given : whether the strain of the cell is given, but for shears.
    is_free : whether the cell has unknown strains.
    """

    def __init__(self, problem: Problem) -> None:
        assembly = problem.assembly
        assert isinstance(assembly, GridAssembly)
        assert isinstance(assembly.law, hertz.HertzLaw)
        coefficient = assembly.law.coefficient
        grid = assembly.grid
        self.problem = problem
        self.grid: Grid = grid
        self.n_fields = grid.n_balls * len(grid.shape)
        offset = assembly.offset.reshape(grid.n_kinds, grid.n_cells)
        self.spread = float(np.std(offset))
        normal = grid.normal
        strained = np.einsum("ka,sab,kb->ks", normal, problem.unit_strains, grid.vector)
        given = -np.einsum("ka,ab,kb->k", normal, problem.given_strain, grid.vector)
        # kinds that lose alike do so to the last digit, and are worked on together
        is_even = float(np.max(np.ptp(strained, axis=0), initial=0.0)) <= ROUNDING * float(
            np.max(np.abs(strained), initial=0.0)
        ) and float(np.ptp(given)) <= ROUNDING * float(np.max(np.abs(given)))
        if is_even:
            strained[:] = strained[0]
            given[:] = given[0]
        #: whether all contacts have one common overlap
        self.is_even = is_even
        stress = problem.load.stress
        work = np.zeros(strained.shape[1])
        if stress is not None:
            work = problem.find_work(stress)
        if problem.load.mean_force is not None:
            work = -problem.load.mean_force * grid.n_cells * np.sum(strained, axis=0)
        force = _find_mean_force(problem, grid)
        length = _WIDTH_OVER_RMS * self.spread
        if not length:
            length = float(hertz.overlap_of(force / coefficient)) or float(np.max(np.abs(given)))
        self.unit = 2.0 ** round(math.log2(length)) if 0.0 < length < math.inf else 1.0
        self.force_unit = coefficient * self.unit**hertz.EXPONENT
        self.offset = offset if self.unit == 1.0 else offset / self.unit
        self.spread /= self.unit
        self.given = given / self.unit
        self.strained = strained
        self.work = work / self.force_unit
        self.is_given = stress is None and problem.load.mean_force is None
        self.is_free = len(work) > 0
        #: mean force of the contacts under the load, zero where a strain is given
        self.load_force = force / self.force_unit
        #: directions in which the kinds of contacts push the balls of a cell, (kinds, f)
        pushes = np.zeros((grid.n_kinds, grid.n_balls, len(grid.shape)))
        kinds = np.arange(grid.n_kinds)
        along = normal[:, : len(grid.shape)]
        np.add.at(pushes, (kinds, grid.j), along)
        np.add.at(pushes, (kinds, grid.i), -along)
        self.pushes = pushes.reshape(grid.n_kinds, -1)
        #: whether equal forces of all contacts balance, and one common overlap makes no others
        self.balances = is_even and bool(
            np.all(np.abs(np.sum(self.pushes, axis=0)) <= ROUNDING * grid.n_kinds)
        )

    @cached_property
    def weight(self) -> float:
        """Factor from a force on a strain to a force on each contact; zero without free strains."""
        if not self.is_free:
            return 0.0
        return 1.0 / (self.grid.n_cells * float(np.max(np.sum(np.abs(self.strained), axis=0))))

    def needs_more_load(self, options: RestOptions) -> bool:
        """Return whether the search is to begin at rest under a larger load: where balls differ and
        the mean force of the load is below those of ``options.interior_forces``.
        """
        if self.is_given or not self.spread:
            return False
        return bool(self.load_force < options.interior_forces[0])

    def begins_inside(self, strains: Array, options: RestOptions) -> bool:
        """Return whether the interior-point method is to come before Newton's: where balls differ,
        and many contacts are open under a load or a strain like this one, with ``strains`` (s,).
        """
        # in space that takes too many iterations without factors
        if not self.spread or (len(self.grid.shape) == 3 and not is_small(self.grid, options)):
            return False
        common = self.find_common(strains)
        if self.is_given:
            closed = np.mean(common[:, None] + self.offset > 0.0)
            return bool(closed < options.closed_on_sites)
        force = float(np.mean(hertz.force_of(common)))
        least, most = options.interior_forces
        return bool(least <= force <= most)

    def needs_fine_start(self, options: RestOptions) -> bool:
        """Return whether a search in exact directions is to begin at a rest of this problem that is
        found to the end: where loose balls depend on it, and it is not the interior-point method
        that leads there.
        """
        if self.is_given:
            leaves_loose = float(np.mean(self.given)) < options.differing
        else:
            leaves_loose = self.load_force < options.differing
        return leaves_loose and not self.begins_inside(self.find_strains(), options)

    def find_strains(self) -> Array:
        """Return the strains (s,) under which equal contacts have the mean force of the load; zeros
        where a strain is given.
        """
        if self.is_given:
            return np.zeros(len(self.work))
        wanted = self.given - float(hertz.overlap_of(self.load_force))
        strains, *_ = np.linalg.lstsq(self.strained, wanted, rcond=None)
        return np.asarray(strains)

    def find_common(self, strains: Array) -> Array:
        """Return the overlaps (kinds,) that strains (s,) make."""
        return np.asarray(self.given - self.strained @ strains)

    def measure_losses(self, balls: Values) -> Values:
        """Return (kinds, cells) losses of overlap by displacements (f, cells)."""
        loss = np.empty(self.offset.shape, balls.dtype)
        grid_loops.measure_losses(self.grid.runs, balls, loss)
        return loss

    def add_losses(self, loss: Values, strains: Array) -> Values:
        """Add to losses of overlap (kinds, cells), in place, those by strains (s,), and return
        them.
        """
        if len(strains):
            loss += (self.strained @ strains)[:, None]
        return loss

    def collect(self, force: Values) -> Values:
        """Return the forces on balls (f, cells) that forces of contacts (kinds, cells) make; the
        ``force`` of a contact is above zero where balls are pushed apart.
        """
        on_balls = np.zeros((self.n_fields, self.grid.n_cells), force.dtype)
        grid_loops.add_forces(self.grid.runs, force, on_balls)
        return on_balls

    def find_largest(self, on_balls: Values) -> float:
        """Return the size of the largest of the forces (f, cells) on balls."""
        d = len(self.grid.shape)
        squares = np.einsum("bac,bac->bc", *(2 * [on_balls.reshape(-1, d, self.grid.n_cells)]))
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
    return grid.n_cells * grid.n_balls <= options.most_factorised[len(grid.shape)]


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
