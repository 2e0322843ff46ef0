"""Mechanical equilibrium of an array of balls of different diameters, in reduced units.

In the paper's limit, where spread and overlap are small compared with the diameter, the directions
of contacts stay those of the lattice. In units of W and of the force c W^(3/2) (Section IV) a
contact has the overlap

    h = y + (x_i + x_j)/2 - n.(u_j - u_i)

with y = (d - a)/W common to all contacts, and carries the force h_+^(3/2). Equilibrium is the
minimum of the sum of (2/5) h_+^(5/2) over all u; at given load, the minimum over y too, with the
work of the load subtracted. This function is convex. The array is an assembly
(:mod:`granphon.contacts.assembly`) on a grid, and comes to rest as others do
(:mod:`granphon.statics.find_rest`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.contact_lists import Springs, list_on_lattice, select_resisted
from granphon.array.geometry import ExactPlace, find_boundary_force
from granphon.array.shift_iteration import ShiftIteration
from granphon.array.stencils import Stencils
from granphon.balls import hertz
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.base.arrays import Array, Flags
from granphon.base.errors import ConvergenceError, InputError
from granphon.base.results import Result, held, result_class
from granphon.contacts import grid_loops
from granphon.contacts.assembly import ROUNDING
from granphon.contacts.contact_list import ContactList
from granphon.contacts.grid import find_lattice_grid
from granphon.contacts.tangent import unit_strains
from granphon.statics.configuration import list_shears
from granphon.statics.lattice_equations import LatticeIteration
from granphon.statics.options import ResponseOptions, RestOptions
from granphon.statics.response import GridResponse, find_elastic_tensor

#: largest force that may be left on a ball at rest, over the mean contact force, or over the rms
#: difference of contact forces if that is less
REST_TOLERANCE = 1e-10
#: f* below which a sample with open contacts counts as carrying no load: it is below its rigidity
#: threshold, or above it by no more than 1e-5 W
THRESHOLD_FORCE = RestOptions().threshold
#: force of a contact, over the largest residual force on a ball, above which the contact counts as
#: carrying load. In practice the ratio is either far below one or above a hundred
CARRIED_FORCE = RestOptions().open_force


@result_class
class Equilibrium(Result):
    """Sample at rest, in units of W and c W^(3/2).

    Attributes
    ----------
    deviations : (L1, ..., Lp) x = Delta/W of the balls, where Delta is the diameter less the mean
        diameter d; (n, L1, ..., Lp) if a cell has n > 1 balls.
    overlap : y, the part of the overlap that all contacts have in common.
    balls : (n p, L1, ..., Lp) displacements in units of W, in the coordinates of
        :class:`~granphon.array.stencils.Stencils`.
    residual : largest force left on a ball, divided by the mean contact force; infinite if all
        contacts are open.
    newton, conjugate : numbers of steps of Newton's method, and of iterations of the solvers of its
        linear equations.
    lattice : the lattice of the contacts.
    ratio : W/d in the true geometry; zero where contacts keep the directions of the lattice.
    strain : (p, p) symmetric strain of the cell, in units of W/d, added to the even one, -y, if the
        cell has taken the shape in which its stress is hydrostatic; None if the cell keeps its
        shape. In both cases the size of the cell is (1 - y W/d)^p times that at y = 0.

    In arrays of contacts the first axis is the kind of contact, in the order of the lattice's
    table: (n_c, L1, ..., Lp).
    """

    deviations: Array = held(float, "...", within="finite")
    overlap: float = held(float, within="finite")
    balls: Array = held(float, "*", within="finite")
    residual: float = held(float, within="zero or above, or infinite", default=math.inf)
    newton: int = held(int, default=0)
    conjugate: int = held(int, default=0)
    lattice: Lattice = held(Lattice, default=TRIANGULAR)
    ratio: float = held(float, within="zero or above", default=0.0)
    strain: Array | None = held(float, "p p?", within="finite", default=None)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what the equilibrium is made from again when it is unpickled, with the derivatives
        that it has found: each costs a linear response.
        """
        return *super().__reduce__(), {"derivatives": self.derivatives}

    def share(self, deviations: Array, stencils: Stencils) -> Self:
        """Return an equal equilibrium that holds the array ``deviations`` and the ``stencils``,
        which must be equal to its own: if other equilibria hold them too, they take memory once.
        The derivatives and the place that this equilibrium has found are kept.
        """
        twin = replace(self, deviations=deviations)
        names = {"derivatives", "place"} & vars(self).keys()
        cached_values = {name: vars(self)[name] for name in names}
        vars(twin).update(cached_values, stencils=stencils)
        return twin

    @cached_property
    def stencils(self) -> Stencils:
        """Compatibility matrix C of the array, without slips."""
        return Stencils(array_shape(self.deviations, self.lattice), lattice=self.lattice)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the arrays, or the strain, do not
        belong to balls on the lattice.
        """
        super()._check()
        shape = array_shape(self.deviations, self.lattice)
        expected = self.lattice.n_balls * self.lattice.periods, *shape
        if len(shape) != self.lattice.periods or np.shape(self.balls) != expected:
            shapes = (
                f"deviations of the shape {np.shape(self.deviations)} and balls of"
                f" {np.shape(self.balls)}"
            )
            raise InputError(
                f"the Equilibrium has {shapes}, which is no array of the {self.lattice.name}"
                " lattice"
            )
        p = self.lattice.periods
        if self.strain is not None and self.strain.shape != (p, p):
            raise InputError(
                f"the Equilibrium has a strain of the shape {self.strain.shape}, and the"
                f" {self.lattice.name} lattice {p} periods"
            )

    @cached_property
    def place(self) -> ExactPlace:
        """Configuration of the balls in the geometry of the equilibrium: the true one or, with a
        ``ratio`` of zero, that of the lattice.
        """
        array = (self.stencils, self.deviations, self.ratio)
        return ExactPlace(*array, self.balls, self.overlap, self.strain)

    @property
    def differences(self) -> Array:
        """(n_c, L1, ..., Lp) differences h - y of the overlaps of contacts from the common part.
        Contacts that are known to stay open have at most -y, so that h is not above zero.
        """
        if self.ratio:
            differences = self.place.differences
        else:
            differences = self.stencils.average_pairs(self.deviations)
            differences -= self._measure_losses()
            if self.strain is not None:
                differences -= self._elongate(self.strain)
        if self._stay_open is None:
            return differences
        return np.where(self._stay_open, np.minimum(differences, -self.overlap), differences)

    #: (n_c, L1, ..., Lp) whether each contact counts as open wherever the balls are; None if none
    #: does. A course sets this on its states (:mod:`granphon.array.equilibrium_courses`)
    _stay_open: ClassVar[Flags | None] = None

    def _measure_losses(self) -> Array:
        """Return the overlap that each contact loses along its direction on the lattice by the
        displacements of its balls, (n_c, L1, ..., Lp).
        """
        stencils = self.stencils
        p = stencils.lattice.periods
        grid = find_lattice_grid(stencils.shape, stencils.lattice)
        displacements = stencils.displacements(self.balls).reshape(p, grid.n_balls, -1)
        # ball after ball, each with its p components
        fields = np.ascontiguousarray(displacements.swapaxes(0, 1)).reshape(-1, grid.n_cells)
        loss = np.empty((grid.n_kinds, grid.n_cells))
        grid_loops.measure_losses(grid.runs, fields, loss)
        return loss.reshape(-1, *stencils.shape)

    def _elongate(self, strain: Array) -> Array:
        """Return what a ``strain`` (p, p) of the cell adds to the lengths of contacts along their
        directions on the lattice, (n_c, 1, ..., 1), in units of W.
        """
        p = self.lattice.periods
        normal = self.lattice.contacts.normal[:, :p]
        elongation = np.einsum("ca,ab,cb->c", normal, strain, normal)  # n.strain.n of each kind
        return np.asarray(elongation[(..., *(None,) * p)])

    @property
    def overlaps(self) -> Array:
        """(n_c, L1, ..., Lp) overlaps h of the contacts; below zero where balls are apart."""
        return self.overlap + self.differences

    @property
    def forces(self) -> Array:
        """(n_c, L1, ..., Lp) contact forces h_+^(3/2); h_+ is h, or zero where balls are apart."""
        return hertz.press(self.overlaps)[0]

    @property
    def excess(self) -> Array:
        """(n_c, L1, ..., Lp) contact forces less y_+^(3/2), without the loss of digits of a
        subtraction where both are nearly alike.
        """
        return hertz.press_further(self.overlap, self.differences)[0]

    @property
    def stiffnesses(self) -> Array:
        """(n_c, L1, ..., Lp) stiffnesses (3/2) h^(1/2) of the contacts that carry load; zero for
        the others.
        """
        return np.asarray(hertz.stiffness_of(self._roots))

    @property
    def stiffness_slopes(self) -> Array:
        """(n_c, L1, ..., Lp) slopes of the stiffnesses, (3/4) h^(-1/2); zero where no load is
        carried.
        """
        return hertz.slope_of(self._roots)

    @property
    def _roots(self) -> Array:
        """(n_c, L1, ..., Lp) square roots h^(1/2) of the overlaps of contacts that carry load; zero
        for all others: their force may be nothing but a residual.

        The iteration leaves balls that nothing holds where they touch others with a trace of force.
        Shear springs at such contacts would hold these balls.
        """
        overlaps = self.overlaps
        least_overlap = hertz.overlap_of(CARRIED_FORCE * self.residual * self.force)
        return np.asarray(np.sqrt(np.where(overlaps > least_overlap, overlaps, 0.0)))

    @property
    def carries(self) -> Flags:
        """(n_c, L1, ..., Lp) whether each contact carries load."""
        return self._roots > 0.0

    @cached_property
    def force(self) -> float:
        """Mean contact force f*, a reduced number."""
        return float(hertz.force_of(self.overlap)) + float(np.mean(self.excess))

    @property
    def energy(self) -> float:
        """Mean energy of a contact, in units of c W^(5/2)."""
        return float(np.mean(hertz.energy_of(self.forces, np.maximum(self.overlaps, 0.0))))

    @property
    def boundary_force(self) -> float:
        """Mean contact force f*, a reduced number, that has the same pressure in a cell that keeps
        its size.
        """
        return find_boundary_force(self.place, self.forces) if self.ratio else self.force

    def response(self) -> Array:
        """Return the derivatives (n_c, L1, ..., Lp) of the overlaps of contacts with respect to y,
        while balls stay in balance. They are computed anew at each call. Where no contact carries
        load, nothing moves the balls, and the derivatives are one.

        Raises :class:`~granphon.base.errors.ConvergenceError` if they are not found, as where the
        cell has sheared and a shear of it costs nothing.
        """
        stiffness = self.stiffnesses
        if not np.any(stiffness):
            return np.ones_like(stiffness)
        response = self._respond(1.0)
        shears = list_shears(self.lattice.periods)
        if self.strain is None or not len(shears):
            return response
        # the cell shears so far that the stress stays hydrostatic: no shear then does work
        shear_responses = [self._respond(-self._elongate(shear)) for shear in shears]
        coupling = [np.sum(stiffness * response * changes) for changes in shear_responses]
        resistance = [[np.sum(stiffness * a * b) for b in shear_responses] for a in shear_responses]
        try:
            amounts = -np.linalg.solve(resistance, coupling)
        except np.linalg.LinAlgError:
            problem = "the shear with which the stress of a cell stays hydrostatic is not found"
            why = f"A shear of the {self.lattice.name} lattice costs nothing without friction"
            raise ConvergenceError(problem, why, "Let the cell keep its shape") from None
        for amount, changes in zip(amounts, shear_responses, strict=True):
            response = response + amount * changes
        return response

    def _respond(self, change: Array | float) -> Array:
        """Return the changes (n_c, L1, ..., Lp) of the overlaps of contacts after the cell has
        changed and the balls have come into balance again.

        ``change`` are the changes of overlaps if balls keep their places in the cell: a number for
        all contacts, or one for each kind, (n_c, 1, ..., 1).
        """
        stiffness = self.stiffnesses
        # what the forces of contacts gain while balls keep their places
        gain = stiffness * change
        if isinstance(change, float):  # an even change: see _find_uniform_part
            gain = change * (stiffness - _find_uniform_part(stiffness))
        iteration = self._iterate(stiffness)
        forces = iteration.collect(gain.reshape(len(gain), -1))
        if np.max(np.abs(forces)) <= ROUNDING * np.max(np.abs(gain)):
            # the gains balance: near the threshold, what is left of them would be searched in vain
            # for motions of balls that hardly anything holds
            return change * np.ones_like(stiffness)
        motions = GridResponse(iteration).find_motions(forces[..., None])[..., 0]
        return np.asarray(change - iteration.measure(motions).reshape(stiffness.shape))

    def _iterate(self, stiffness: Array) -> LatticeIteration:
        """Return the equations of small motions of balls that do not turn, against contacts of a
        ``stiffness`` (n_c, L1, ..., Lp) in the directions of the lattice.
        """
        grid = find_lattice_grid(self.stencils.shape, self.lattice)
        return LatticeIteration(grid, stiffness.reshape(grid.n_kinds, -1), self.stencils.workers)

    @cached_property
    def derivatives(self) -> dict[int, float]:
        """Derivatives of the mean force f* with respect to y that have been found so far, by their
        order, 1 or 2: empty until :attr:`stiffness` or :attr:`stiffness_slope` is asked for. To
        find them takes one linear response or more.
        """
        return {}

    def _take_derivative(self, order: int) -> float:
        """Return the derivative of the mean force of this ``order``, 1 or 2; it is found if it is
        not among the :attr:`derivatives` yet, which then hold it.
        """
        if order not in self.derivatives:
            self.derivatives.update(self._find_derivatives(order))
        return self.derivatives[order]

    def _find_derivatives(self, order: int) -> dict[int, float]:
        """Return derivatives of the mean force of contacts with respect to y, reduced, by their
        order: that of this ``order``, 1 or 2, and the other one if it costs nothing more, as here.
        They are the second and the third derivative of the energy per contact.

        In equilibrium the first response r of the overlaps is enough for both, by the (2n + 1)
        theorem: the derivatives are the means <k r^2> and <k' r^3> over contacts, with the
        stiffness k of a contact and its slope k'.
        """
        response = self.response()
        stiffness = float(np.mean(self.stiffnesses * response**2))
        slope = float(np.mean(self.stiffness_slopes * response**3))
        return {1: stiffness, 2: slope}

    @property
    def stiffness(self) -> float:
        """Stiffness df*/dy, a reduced number; kept among the :attr:`derivatives`. Raises the error
        of :meth:`response`.
        """
        return self._take_derivative(1)

    @property
    def stiffness_slope(self) -> float:
        """Slope of the stiffness, d^2f*/dy^2, a reduced number; kept among the
        :attr:`derivatives`. Raises the error of :meth:`response`.
        """
        return self._take_derivative(2)

    def find_elasticity(
        self,
        shear: ArrayLike,
        torsion: ArrayLike = 0.0,
        bending: float = 0.0,
        reduction: float | None = None,
    ) -> Array:
        """Return the (n, n) elastic tensor of the array, in Voigt order, with springs at every
        contact that carries load.

        Under a small uniform strain each ball moves and turns until it is in balance again; the
        energy that the contacts then store is the elastic energy. This rests on the contacts alone,
        without an effective medium or a conjecture about friction.

        The stiffness of springs against slip, twist and roll is ``shear`` (eta), ``torsion`` (over
        d^2) and ``bending`` (over d^2) times the normal stiffness of their contact; shear and
        torsion are numbers, or (n_c, L1, ..., Lp). Without shear no ball turns, and torsion and
        bending are not used. Energies are per d^p, and the unit is c W^(1/2), that of stiffnesses.
        ``reduction`` is the error of the linear response in the norm of the energy, by default that
        of the statics; the error of the tensor is of the order of its square.

        Contacts that bear no more than :data:`CARRIED_FORCE` times the largest force left on a ball
        count as open. It matters more which contacts count as open than how large their forces are:
        a stiffness is proportional to f^(1/3), and two contacts with some 1e-10 of the mean force
        make 2e-6 of the tensor of 64 x 64 balls.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the response is not found.
        """
        options = ResponseOptions() if reduction is None else ResponseOptions(reduction=reduction)
        if not self.ratio and self.deviations.size > options.most_balls[self.lattice.periods]:
            return self._find_tensor_on_grid(shear, torsion, bending, options)
        return find_elastic_tensor(self._list_contacts(shear, torsion, bending), options)

    def _find_tensor_on_grid(
        self, shear: ArrayLike, torsion: ArrayLike, bending: float, options: ResponseOptions
    ) -> Array:
        """Return the tensor of :meth:`find_elasticity` by conjugate gradients on the grid, which
        take less memory than a list of contacts; ``options`` are those of the response.
        """
        normal = self.stiffnesses
        stencils = self._find_stencils(normal, shear, torsion, bending)
        if stencils.n_rows == stencils.n_contacts:
            # balls that do not turn
            lattice_iteration = self._iterate(normal)
            strain_forces = lattice_iteration.find_strain_forces(unit_strains(self.lattice.periods))
            response = GridResponse(lattice_iteration, *strain_forces, options)
        else:
            ratios = {"slip": np.asarray(shear), "twist": np.asarray(torsion)}
            iteration = ShiftIteration(stencils, stencils.weights(normal, **ratios))
            response = GridResponse(iteration, iteration.ahead, iteration.corner, options)
        del normal  # the response has what it needs of a large array
        measure = float(self.lattice.measure) * math.prod(stencils.shape)
        return response.stiffness / measure

    def _find_stencils(
        self, normal: Array, shear: ArrayLike, torsion: ArrayLike, bending: float
    ) -> Stencils:
        """Return the stencils of the array for the springs of :meth:`find_elasticity`; ``normal``
        (n_c, L1, ..., Lp) are the stiffnesses of those along contacts.

        The stencils have one ratio of each kind for all contacts, with which the preconditioner is
        made: the mean of the ratios, weighted by ``normal``.
        """
        total = float(np.sum(normal))
        slip = float(np.sum(np.asarray(shear, float) * normal)) / total
        twist = float(np.sum(np.asarray(torsion, float) * normal)) / total
        if not slip:
            # only shear turns balls that are strained: without it twist and roll store nothing
            twist = 0.0
            bending = 0.0
        shape = self.stencils.shape
        return Stencils(shape, slip, self.stencils.workers, self.lattice, twist, bending)

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts as a list, with the springs of :meth:`find_elasticity`; those of
        contacts that carry no load have no stiffness.
        """
        normal = self.stiffnesses
        slip = np.asarray(shear, float) * normal
        if not np.any(slip):
            # only shear turns balls that are strained: without it twist and roll store nothing
            torsion = 0.0
            bending = 0.0
        motions = select_resisted(self.lattice, slip, torsion, bending)
        springs = Springs.of(normal, slip, np.asarray(torsion) * normal, bending * normal)
        return list_on_lattice(self.stencils.shape, self.lattice, motions, springs)


def _find_uniform_part(stiffness: Array) -> float:
    """Return the constant that is subtracted from the stiffnesses of all contacts in the response
    to an even strain: the mean of ``stiffness`` (n_c, L1, ..., Lp) if all contacts are closed, and
    zero otherwise.

    Equal tension in all contacts moves nothing, so any constant may be subtracted. If all contacts
    are closed, they are nearly alike, and subtracting the mean saves digits. If some are open, the
    rounding of a subtracted constant would pull at balls that nothing holds.
    """
    return float(np.mean(stiffness)) if np.all(stiffness) else 0.0


def array_shape(deviations: Array, lattice: Lattice) -> tuple[int, ...]:
    """Return the numbers of cells (L1, ..., Lp) of an array of balls with ``deviations``, (L1, ...,
    Lp), or (n, L1, ..., Lp) if a cell of the ``lattice`` has n > 1 balls.
    """
    shape = np.shape(deviations)
    return shape[1:] if lattice.n_balls > 1 else shape


def explain_too_small(force: float) -> InputError:
    """Return the error for a reduced force below :data:`THRESHOLD_FORCE`."""
    return InputError(
        f"a mean contact force of f* = {force:.3g} is below f* = {THRESHOLD_FORCE:g}",
        "Such a sample is at its rigidity threshold, where its equilibrium cannot be found",
        "Raise the load",
    )


def explain_no_load(overlap: float) -> InputError:
    """Return the error for an overlap y at which a sample is below its rigidity threshold."""
    return InputError(
        f"at an overlap of {overlap:.6g} widths this sample carries no load",
        f"Its force is below f* = {THRESHOLD_FORCE:g}: too few balls touch to hold each other",
        "Press it together more",
    )
