"""A sample of the disordered array at rest: all its balls and contacts, in SI units."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.atoms import SAMPLE, count_coordinates, take_arrays
from granphon.array.equilibrium import Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.sheared_equilibrium import equilibrate_as
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import COUNTED_FORCE
from granphon.balls.lattices import BALL, Lattice
from granphon.balls.packing import MINDLIN, Packing
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, brief, needing
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import Units, WidthUnits
from granphon.base.validation import not_negative, real_number, whole_number
from granphon.dynamics.compatibility import GYRATION
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from ase import Atoms


#: step in log f, to either side, for finite differences of moduli. The bias of an exponent is
#: proportional to the square of the step: at f* = 1, where the statistical error is least, the bias
#: is 2e-3 STEP^2 = 5e-6, as large as the standard error of a million balls. The variance grows only
#: as -log STEP. The derivative itself, by one linear response in place of two equilibria, would be
#: a worse estimate: with a step of 0.002 exponents of 24^2 balls scatter up to 1.8 times as much,
#: as contacts about to open or close count for more than their part
STEP = 0.05
#: force that may be left on a ball under the two loads beside that of the sample, over the mean
#: force. Exponents differ by 1e-7 or less from those found with 1e-10. In the true geometry, at a
#: few hundredths of f* = 1, loose balls come to rest at other places, and exponents differ by up to
#: 6e-4 in every third sample
_TOLERANCE = 1e-8
#: the linear response under the loads beside is as exact as the rest, as its error enters squared
_REDUCTION = math.sqrt(_TOLERANCE)


@result_class
class Sample(Result):
    """One array of balls at rest under one load.

    Attributes
    ----------
    packing : the packing from which the sample is drawn.
    seed : random seed of the diameters; None if the diameters were given.
    equilibrium : the solution, in units of W and c W^(3/2).

    Arrays are indexed by the cell (k, l, ...): on the triangular lattice the site of the ball is k
    a1 + l a2. Where a cell has several balls, arrays of balls have one more axis, (L1, ..., Lp, n).
    The last axis of contact arrays is the kind of contact, as in the contact table of the lattice:
    on the triangular one from ball (k, l) to (k, l + 1), (k + 1, l) and (k + 1, l + 1).
    """

    packing: Packing = held(Packing)
    seed: int | None = held(int, "?")
    # both classes are named, so that plain data become an object of either
    equilibrium: Equilibrium | TrueEquilibrium = held(Equilibrium | TrueEquilibrium)

    @property
    def _units(self) -> WidthUnits:
        """The units of the equilibrium in SI."""
        return self.packing.width_units

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of cells (L1, ..., Lp)."""
        return self.equilibrium.stencils.shape

    def _order(self, values: Array) -> Array:
        """Return ``values`` of balls with the axis of the n balls of a cell last: (..., n, L1, ...,
        Lp) becomes (..., L1, ..., Lp, n). With one ball in the cell there is no such axis, and
        ``values`` are returned as they are.
        """
        has_axis = self.packing.structure.n_balls > 1
        return np.moveaxis(values, -1 - len(self.shape), -1) if has_axis else values

    @property
    def diameters(self) -> Array:
        """(L1, ..., Lp) diameters, m; their mean is the packing's diameter."""
        return np.asarray(
            self.packing.diameter + self._units.width * self._order(self.equilibrium.deviations)
        )

    @property
    def sites(self) -> Array:
        """(L1, ..., Lp, p) lattice sites k a1 + l a2 + ..., in mean diameters; where a cell has
        several balls, plus the place of each in the cell.
        """
        structure = self.packing.structure
        index = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        cells = np.asarray(index @ structure.vectors)
        return cells if structure.n_balls == 1 else cells[..., None, :] + structure.positions

    @property
    def displacements(self) -> Array:
        """(L1, ..., Lp, p) displacements, m, from the sites, which follow the compressed cell.
        Balls that nothing holds are where the iteration left them.
        """
        in_widths = self.equilibrium.stencils.displacements(self.equilibrium.balls)
        return self._units.width * np.moveaxis(self._order(in_widths), 0, -1)

    @property
    def contact_overlaps(self) -> Array:
        """(L1, ..., Lp, n_c) overlaps of the contacts, m; below zero where balls are apart."""
        return self._units.width * np.moveaxis(self.equilibrium.overlaps, 0, -1)

    @property
    def contact_forces(self) -> Array:
        """(L1, ..., Lp, n_c) forces of the contacts, N; zero where balls are apart."""
        return self._units.force * np.moveaxis(self.equilibrium.forces, 0, -1)

    @property
    def overlap(self) -> float:
        """Mean overlap delta = d - a, m."""
        return self._units.width * self.equilibrium.overlap

    @property
    def force(self) -> float:
        """Mean contact force f, N, over all contacts, open ones included."""
        return self._units.force * self.equilibrium.force

    @property
    def boundary_force(self) -> float:
        """Mean contact force, N, that has the same pressure in a cell that keeps its size; in the
        true geometry it differs from the mean ``force``.
        """
        return self._units.force * self.equilibrium.boundary_force

    @property
    def pressure(self) -> float:
        """Pressure, N/m in the plane, Pa in space, N on a line: the work of the load over the
        change of the cell's size.

        Raises :class:`~granphon.base.errors.InputError` if the stress of the lattice is not a
        pressure.
        """
        return self.packing.pressure_per_force * self.boundary_force

    @property
    def normal_stiffness(self) -> float:
        """Normal stiffness df/d(delta), N/m.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the linear response is not found.
        """
        return self._units.stiffness * self.equilibrium.stiffness

    @property
    def stiffness_slope(self) -> float:
        """Slope of the normal stiffness, d^2f/d(delta)^2, N/m^2; raised is the error of
        :attr:`normal_stiffness`.
        """
        return self._units.stiffness_slope * self.equilibrium.stiffness_slope

    @property
    def energy(self) -> float:
        """Mean energy of a contact, J, open ones included."""
        return self._units.energy * self.equilibrium.energy

    @property
    def residual(self) -> float:
        """Largest force left on a ball, divided by the mean contact force."""
        return self.equilibrium.residual

    @property
    def force_fluctuation(self) -> float:
        """Delta f / f: rms deviation, over balls, of the mean force of the contacts of a ball,
        divided by the mean force.
        """
        state = self.equilibrium
        return float(np.std(state.stencils.average_around(state.excess))) / state.force

    @property
    def contact_force_fluctuation(self) -> float:
        """Rms deviation of the forces of single contacts, open ones included, from the mean force,
        divided by the mean force.
        """
        return float(np.std(self.equilibrium.excess)) / self.equilibrium.force

    def contact_fraction(self, threshold: float = COUNTED_FORCE) -> float:
        """Return N_c / z, the fraction of contacts that carry more than ``threshold`` times the
        mean force, by default 1e-6. Raises :class:`~granphon.base.errors.InputError` unless
        ``threshold`` is a finite number, zero or above.
        """
        least_part = not_negative("threshold", threshold)
        return float(np.mean(self.equilibrium.forces > least_part * self.equilibrium.force))

    def force_distribution(
        self, bins: int = 60, largest: float = 6.0, least: float = 0.0
    ) -> tuple[Array, Array]:
        """Return the edges (bins + 1,) of bins in f/<f>, and the probability density (bins,) of
        f/<f>: f are the forces of the contacts that carry more than a part 1e-6 of the mean force,
        and <f> is the mean force of all contacts, open ones included. So the mean of f/<f> is one
        where no contact is left out, and above one elsewhere.

        The bins reach from ``least`` to ``largest`` times the mean force; over all forces the
        density integrates to one. Raises :class:`~granphon.base.errors.InputError` if ``bins`` is
        no whole number from 1 to a million; unless ``least`` and ``largest`` are finite and
        ``largest`` is the greater; or if bins would be so narrow, or so wide, that their edges or
        densities are no numbers.
        """
        forces = self.equilibrium.forces
        forces = forces[forces > COUNTED_FORCE * self.equilibrium.force] / self.equilibrium.force
        return find_density(forces, bins, least, largest)

    @cached_property
    def elastic_tensor(self) -> Array:
        """Elastic tensor in Voigt order: (3, 3), Pa, of a layer one diameter thick; (6, 6), Pa; (1,
        1), N, of a chain.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the linear response is not found.
        """
        return self._compute_elastic_tensor(self.equilibrium)

    @cached_property
    def elastic_tensors_beside(self) -> Array:
        """(2, n, n) elastic tensors of the same balls under exp(-:data:`STEP`) and exp(STEP) times
        the mean force.

        This takes two more equilibria, each started from this one if the cell keeps its shape, and
        their linear responses. Raises :class:`~granphon.base.errors.ConvergenceError` if one of
        these is not found.
        """
        equilibrium = self.equilibrium
        loads = [ReducedLoad(force=equilibrium.force * math.exp(step)) for step in (-STEP, STEP)]
        neighbours = [equilibrate_as(equilibrium, load, _TOLERANCE) for load in loads]
        return read_only(
            [self._compute_elastic_tensor(neighbour, _REDUCTION) for neighbour in neighbours]
        )

    @cached_property
    def network(self) -> ContactNetwork:
        """The balls, and the contacts that carry load, as a network.

        Contacts have the directions of the lattice. All balls have the mass, inertia and arms of
        the mean ball, as in the paper's limit. In the true geometry directions and arms are the
        contacts' own, and static forces act on displacements (prestress).
        """
        return self._make_network()

    def _make_network(
        self, shear: ArrayLike | None = None, tangential: Array | None = None
    ) -> ContactNetwork:
        """Return the network of the balls and of the contacts that carry load.

        ``shear`` is the ratio of tangential to normal stiffness, a number or (L1, ..., Lp, n_c);
        None stands for that of the packing. ``tangential`` (L1, ..., Lp, n_c, p) are tangential
        forces of ball i on ball j, N. If ``tangential`` is None, the network has no tangential
        forces; in the true geometry, where static forces act on displacements, it has zeros.
        """
        packing = self.packing
        structure = packing.structure
        d = packing.diameter
        p = structure.periods
        i, j, shift = _number_ends(structure, self.shape)
        stiffness = self._units.stiffness * np.moveaxis(self.equilibrium.stiffnesses, 0, -1)
        is_loaded = stiffness.reshape(i.shape) > 0.0
        normal, arm_i, arm_j = (values[is_loaded] for values in self._find_frames(i.shape))
        force = self.contact_forces.reshape(i.shape)[is_loaded]
        spring = stiffness.reshape(i.shape)[is_loaded]
        eta = packing.mindlin_ratio if shear is None else shear
        ratio = np.broadcast_to(eta, stiffness.shape).reshape(i.shape)[is_loaded]
        positions = self._find_positions()
        mass = np.full(len(positions), packing.mass)
        twist = packing.find_torsion(force, spring)
        return ContactNetwork(
            cell=self._find_cell(),
            pbc=(p > 0, p > 1, p > 2),
            positions=positions,
            radii=0.5 * self.diameters.ravel(),
            masses=mass,
            inertias=(GYRATION * d) ** 2 * mass,
            i=i[is_loaded],
            j=j[is_loaded],
            shift=shift[is_loaded],
            normal=normal,
            normal_force=force,
            normal_stiffness=spring,
            shear_stiffness=ratio * spring,
            torsion_stiffness=twist * d * d * spring,
            bending_stiffness=packing.bending * d * d * spring,
            arm_i=arm_i,
            arm_j=arm_j,
            motions=packing.named_motions.name,
            dimension=structure.dimension,
            prestress=self.is_exact,
            lattice=None if self.is_exact else structure,
            shape=None if self.is_exact else self.shape,
            tangential_force=self._list_tangential(tangential, is_loaded),
            contact_model=ContactModel.of(packing),
        )

    def _list_tangential(self, tangential: Array | None, is_loaded: Flags) -> Array | None:
        """Return the ``tangential`` forces of :meth:`_make_network` of the contacts where
        ``is_loaded`` (cells, n_c) is true, (contacts, 3), N. Without them these are zeros in the
        true geometry, and None otherwise.
        """
        if tangential is None and not self.is_exact:
            return None
        forces = np.zeros((np.count_nonzero(is_loaded), 3))
        if tangential is not None:
            p = tangential.shape[-1]
            forces[:, :p] = tangential.reshape(*is_loaded.shape, p)[is_loaded]
        return forces

    def _find_positions(self) -> Array:
        """Return the centres (balls, 3) of the balls, m. The cell is compressed in the true
        geometry; otherwise the sites are those of the lattice.
        """
        p = self.packing.structure.periods
        sites = self.packing.diameter * self.sites @ self._deformation
        positions = np.zeros((self.equilibrium.deviations.size, 3))
        positions[:, :p] = (sites + self.displacements).reshape(-1, p)
        return positions

    def _find_cell(self) -> Array:
        """Return the vectors (3, 3) of the cell of the array, m: compressed in the true geometry,
        and otherwise those of the lattice. The rows from p on are zeros if the array has fewer than
        three periods.
        """
        structure = self.packing.structure
        p = structure.periods
        cell = np.zeros((3, 3))
        lengths = np.array(self.shape)[:, None]  # in cells of the lattice
        vectors = self.packing.diameter * structure.vectors[:, :p] * lengths
        cell[:p, :p] = vectors @ self._deformation
        return cell

    def _find_frames(self, shape: tuple[int, ...]) -> tuple[Array, Array, Array]:
        """Return the normals (cells, n_c, 3) and the arms of balls i and of balls j (cells, n_c),
        m, of all contacts; ``shape`` is (cells, n_c).
        """
        structure = self.packing.structure
        table = structure.contacts
        d = self.packing.diameter
        if self.is_exact:
            place = self.equilibrium.place
            by_kind = place.normal.reshape(len(table), -1, 3)
            # in diameters: ``size`` is the sum of both arms, and arm j is longer than arm i by
            # twice ``uneven``
            arms = (0.5 * place.size - place.uneven, 0.5 * place.size + place.uneven)
            arm_i, arm_j = (d * np.moveaxis(arm, 0, -1).reshape(shape) for arm in arms)
            return np.ascontiguousarray(by_kind.swapaxes(0, 1)), arm_i, arm_j
        normal = np.zeros((*shape, 3))
        normal[..., : structure.dimension] = table.normal
        arm_i, arm_j = (np.broadcast_to(d * arm, shape) for arm in (table.arm_i, table.arm_j))
        return normal, arm_i, arm_j

    @property
    def is_exact(self) -> bool:
        """Whether directions, arms and overlaps of contacts follow from the positions of the balls;
        otherwise contacts have the directions of the lattice.
        """
        return bool(self.equilibrium.ratio)

    @property
    def _deformation(self) -> Array:
        """(p, p) symmetric matrix that takes vectors of the lattice to those of the compressed
        cell; the unit matrix if contacts keep the directions of the lattice.
        """
        equilibrium = self.equilibrium
        deformation = (1.0 - equilibrium.ratio * equilibrium.overlap) * np.eye(len(self.shape))
        if equilibrium.strain is not None:
            deformation += equilibrium.ratio * equilibrium.strain
        return deformation

    def _compute_elastic_tensor(
        self, equilibrium: Equilibrium, reduction: float | None = None
    ) -> Array:
        """Return the elastic tensor of an ``equilibrium`` of this packing, with the units of
        :attr:`elastic_tensor`; ``reduction`` is the error of the linear response.
        """
        packing = self.packing
        d = packing.diameter
        is_line = packing.structure.periods == 1
        scale = self._units.stiffness * d if is_line else self._units.stiffness / d
        torsion: Any = packing.torsion
        if torsion == MINDLIN:  # the torsion then differs from contact to contact
            f = self._units.force * equilibrium.forces
            k = self._units.stiffness * equilibrium.stiffnesses
            torsion = packing.find_torsion(f, k)
        return read_only(scale * self._find_elasticity(equilibrium, torsion, reduction))

    def _find_elasticity(
        self, equilibrium: Equilibrium, torsion: Any, reduction: float | None
    ) -> Array:
        """Return the elastic tensor of an ``equilibrium`` in its own units; ``torsion`` is a
        number, or (n_c, L1, ..., Lp), and ``reduction`` is the error of the linear response.
        """
        packing = self.packing
        ratio = packing.mindlin_ratio
        return equilibrium.find_elasticity(ratio, torsion, packing.bending, reduction)

    def atoms(self) -> Atoms:
        """Return the sample as an ``ase.Atoms``, in the reduced units of the calculator.

        Balls are at their displaced positions, where contacts have no slip. The Atoms have the
        arrays of a file ``sample.extxyz``, and two more for each ball: ``contact_force``, the mean
        force of its contacts over the mean of all, and ``contacts``, the number of its contacts
        that carry load. To ``granphon.HertzMindlin`` of this sample's state the balls are at rest.

        Raises the error of :attr:`normal_stiffness`, which is the unit of stiffness.
        """
        with needing("A sample of Atoms"):
            from ase import Atoms

        packing = self.packing
        p = packing.structure.periods
        d = packing.diameter
        cell = np.eye(3)  # an axis without a period has the length one
        vectors = packing.structure.vectors[:, :p] @ self._deformation
        cell[:p, :p] = vectors * np.array(self.shape)[:, None]
        displacements, sites = np.zeros((2, self.equilibrium.deviations.size, 3))
        displacements[:, :p] = self.displacements.reshape(-1, p) / d
        sites[:, :p] = self.sites.reshape(-1, p) @ self._deformation
        balls = Atoms(
            [BALL] * len(sites),
            positions=sites + displacements,
            cell=cell,
            pbc=[axis < p for axis in range(3)],
        )
        self._set_arrays(balls, displacements)
        balls.info["relative_overlap"] = self.overlap / d
        return balls

    def _set_arrays(self, balls: Atoms, displacements: Array) -> None:
        """Set the arrays of :meth:`atoms` on ``balls``; ``displacements`` (balls, 3) from the
        sites are in diameters.
        """
        packing = self.packing
        d = packing.diameter
        equilibrium = self.equilibrium
        deviations = self._order(equilibrium.deviations).ravel()
        arrays = {
            "diameter_deviations": self._units.width / d * deviations,
            "displacements": displacements,
            "slip_origin": displacements.copy(),
        }
        units = Units(d, self.normal_stiffness, packing.mass)
        take_arrays(balls, units, SAMPLE, arrays, count_coordinates(packing))
        forces = equilibrium.forces / equilibrium.force
        stencils = equilibrium.stencils
        counts = stencils.sum_around((forces > COUNTED_FORCE).astype(int))
        balls.set_array("contact_force", self._order(stencils.average_around(forces)).ravel())
        balls.set_array("contacts", self._order(counts).ravel())


def find_density(values: Array, bins: int, least: float, largest: float) -> tuple[Array, Array]:
    """Return the edges (bins + 1,) of equal bins from ``least`` to ``largest``, and the probability
    density (bins,) of ``values``, of which there must be at least one.

    Values beyond the edges count in the norm: if there are any, the density integrates over the
    bins to less than one.

    Raises :class:`~granphon.base.errors.InputError` if ``bins`` is no whole number from 1 to a
    million; unless ``least`` and ``largest`` are finite and ``largest`` is the greater; or if bins
    would be so narrow, or so wide, that their edges or densities are no numbers.
    """
    number = whole_number("bins", bins, 1, 1_000_000)
    low = real_number(least)
    high = real_number(largest)
    ends = f"{brief(least)} and {brief(largest)}"
    if not -math.inf < low < high < math.inf:
        raise InputError(f"there are no bins between {ends}", mend="Give a larger upper end")
    with np.errstate(over="ignore", invalid="ignore"):
        widths = np.diff(np.linspace(low, high, number + 1))
        are_distinct = np.all(widths > 0.0) and np.all(np.isfinite(1.0 / widths))
    if not (are_distinct and math.isfinite(high - low)):
        raise InputError(
            f"there are no {number} bins between {ends}",
            "Double precision does not tell their edges apart, or does not hold their widths",
            "Give other ends, or fewer bins",
        )
    counts, edges = np.histogram(values, number, (low, high))
    return edges, counts / values.size / np.diff(edges)


def _number_ends(structure: Lattice, shape: tuple[int, ...]) -> tuple[Index, Index, Index]:
    """Return the numbers (cells, n_c) of balls i, and (cells, n_c) of balls j, of all contacts of
    an array of ``shape`` (L1, ..., Lp) cells. Third, return the shifts (cells, n_c, 3): ball i
    touches the image of ball j that is so many periods of the array away.
    """
    table = structure.contacts
    n = structure.n_balls
    p = structure.periods
    cells = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    cells = cells.reshape(-1, 1, p)
    cells_of_j = cells + table.shift
    cells_in_array = np.moveaxis(np.mod(cells_of_j, shape), -1, 0)
    shift = np.zeros((*cells_of_j.shape[:2], 3), int)
    shift[..., :p] = np.floor_divide(cells_of_j, shape)
    i = n * np.arange(len(cells))[:, None] + table.i
    j = n * np.ravel_multi_index(tuple(cells_in_array), shape) + table.j
    return i, j, shift
