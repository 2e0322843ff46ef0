"""A sample of the disordered array that has been loaded with friction, in SI units.

The forces of the contacts follow from a history (:mod:`granphon.array.history`). Under sound, a
contact that carries load resists compression with its normal stiffness k, and slip with a
tangential stiffness for which there are three choices:

``slide``         eta k; zero where the contact slides, that is, bears |T| = mu f
``stick``         eta k, also where the contact slides: sound of small amplitude may not take it to
                  the limit again
``partial_slip``  eta k (1 - |T|/mu f)^(1/3), that of a contact whose T grows under constant f: an
                  annulus of it slips (C. Cattaneo, 1938; R. D. Mindlin, J. Appl. Mech. 16, 259,
                  1949)

In space the stiffness is the same for slip in all directions.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.equilibrium import Equilibrium
from granphon.array.geometry import find_boundary_force
from granphon.array.history import LoadingHistory
from granphon.array.options import SHEAR_RESPONSES, ReducedLoad
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry, PressedPlace
from granphon.array.sample import STEP, Sample, find_density
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import list_exact_contacts
from granphon.balls.hertz import reduce_by_slip
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.results import held, read_only, result_class
from granphon.base.validation import choice, require
from granphon.contacts.contact_list import ContactList
from granphon.contacts.friction import SLIDING_RATIO, Contacts, FrictionLaw
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from ase import Atoms


@result_class
class PressedEquilibrium(Equilibrium):
    """Sample at rest with the forces that loading with friction has left, in units of W and c
    W^(3/2).

    Attributes that are not listed are those of :class:`~granphon.array.equilibrium.Equilibrium`;
    the cell keeps its shape.

    Attributes
    ----------
    rotations : (n r, L1, ..., Lp) rotations of the n balls of a cell about each of r axes, W over
        the diameter.
    shears : (n_s, n_c, L1, ..., Lp) tangential forces along the n_s slips of each contact; n_s is 1
        in a plane, 2 in space.
    mindlin_ratio, friction_coefficient : eta and mu.
    work : work of the load since the start, a mean over contacts, in units of c W^(5/2).
    slid, loosened, damped : energies lost since the start by sliding, by the law of the tangential
        force, and to dashpots; means over contacts, in units of c W^(5/2). Dashpots act while balls
        come to rest from a gas, and where balls fall.
    steps : number of steps of the load since the start.
    """

    rotations: Array = held(float, "*", within="finite", default_factory=lambda: np.zeros(0))
    shears: Array = held(float, "*", within="finite", default_factory=lambda: np.zeros(0))
    mindlin_ratio: float = held(float, within="zero or above", default=0.0)
    friction_coefficient: float = held(float, within="zero or above, or infinite", default=math.inf)
    work: float = held(float, within="finite", default=0.0)
    slid: float = held(float, within="finite", default=0.0)
    loosened: float = held(float, within="finite", default=0.0)
    damped: float = held(float, within="finite", default=0.0)
    steps: int = held(int, default=0)

    @classmethod
    def of(cls, pressed: PressedArray, deviations: Array, stencils: Stencils, ratio: float) -> Self:
        """Return the ``pressed`` state of a history as an equilibrium; its ``conjugate`` is the
        number of iterations of GMRES.

        ``deviations`` are those of the balls, ``stencils`` those of the history, with slips, and
        ``ratio`` is W/d in the true geometry, or else zero.
        """
        motions = stencils.motions
        fields = pressed.balls.reshape(stencils.n_balls, motions.count, *stencils.shape)
        displacements = fields[:, motions.translating].reshape(-1, *stencils.shape)
        rotations = fields[:, motions.turning].reshape(-1, *stencils.shape)
        return cls(
            deviations=deviations,
            overlap=pressed.overlap,
            balls=displacements,
            residual=pressed.residual,
            newton=pressed.newton,
            conjugate=pressed.krylov,
            lattice=stencils.lattice,
            rotations=rotations,
            shears=pressed.contacts.shears,
            mindlin_ratio=stencils.mindlin_ratio,
            friction_coefficient=pressed.law.friction_coefficient,
            work=pressed.work,
            slid=pressed.slid,
            loosened=pressed.loosened,
            damped=pressed.damped,
            steps=pressed.steps,
            ratio=ratio,
        )

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the arrays do not belong to balls on
        the lattice.
        """
        super()._check()
        stencils = self.sheared
        n_rotations = stencils.n_fields - len(self.balls)
        expected = (
            (n_rotations, *stencils.shape),
            (self.lattice.periods - 1, stencils.n_contacts, *stencils.shape),
        )
        if (self.rotations.shape, self.shears.shape) != expected:
            shapes = (
                f"rotations of the shape {self.rotations.shape} and shears of {self.shears.shape}"
            )
            raise InputError(
                f"the PressedEquilibrium has {shapes}, which do not belong to its balls"
            )

    @cached_property
    def sheared(self) -> Stencils:
        """Compatibility matrix C of the array, with slips."""
        return Stencils(
            self.stencils.shape, self.mindlin_ratio, self.stencils.workers, self.lattice
        )

    @cached_property
    def pressed_place(self) -> PressedPlace:
        """Configuration of the balls with their rotations."""
        geometry = PressedGeometry(self.sheared, self.deviations, self.ratio)
        return geometry.place(self.sheared.spread(self.balls, self.rotations), self.overlap)

    @property
    def boundary_force(self) -> float:
        """Mean contact force f*, a reduced number, that has the same pressure in a cell that keeps
        its size.
        """
        if not self.ratio:
            return self.force
        return find_boundary_force(self.pressed_place, self.forces, self.shears)

    @cached_property
    def law(self) -> FrictionLaw:
        """The law of the contacts."""
        return FrictionLaw(self.mindlin_ratio, self.friction_coefficient)

    @property
    def contacts(self) -> Contacts:
        """State of the contacts. Also in the true geometry, slips are those that the motions of the
        balls make in the directions of the lattice: only changes of slips count.
        """
        stencils = self.sheared
        motion = stencils.spread(self.balls, self.rotations)
        slips = stencils.operator.deform(motion)[stencils.n_contacts :]
        return Contacts(self.overlaps, slips.reshape(self.shears.shape), self.shears)

    def resume(self) -> PressedArray:
        """Return the state from which a history goes on."""
        return PressedArray(
            overlap=self.overlap,
            balls=self.sheared.spread(self.balls, self.rotations),
            contacts=self.contacts,
            law=self.law,
            residual=self.residual,
            work=self.work,
            slid=self.slid,
            loosened=self.loosened,
            damped=self.damped,
            steps=self.steps,
            newton=self.newton,
            krylov=self.conjugate,
        )

    @property
    def energy(self) -> float:
        """Mean energy that a contact stores, in units of c W^(5/2)."""
        return self.law.find_stored_energy(self.contacts)

    def shear_ratios(self, response: str) -> Array:
        """Return the ratio (n_c, L1, ..., Lp) of the tangential to the normal stiffness under
        sound, for a ``response`` of :data:`~granphon.array.options.SHEAR_RESPONSES`.

        With "partial_slip" each contact has the stiffness against a growing tangential force, also
        if this force has just become less.
        """
        if response == "stick":
            return np.full(self.shears.shape[1:], self.mindlin_ratio)
        mobilised = self.law.mobilise(self.contacts)
        share = reduce_by_slip(mobilised) if response == "partial_slip" else 1.0
        return self.mindlin_ratio * np.where(mobilised >= SLIDING_RATIO, 0.0, share)

    def find_elasticity(
        self,
        shear: ArrayLike,
        torsion: ArrayLike = 0.0,
        bending: float = 0.0,
        reduction: float | None = None,
    ) -> Array:
        """Return the elastic tensor (n, n), in Voigt order; ``shear`` are the ratios of
        :meth:`shear_ratios`.

        Other arguments, units and errors are those of
        :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`. In the true geometry
        contacts also have the static forces that act, see
        :func:`~granphon.statics.response.find_elastic_tensor`.
        """
        return super().find_elasticity(shear, torsion, bending, reduction)

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts with their springs and, in the true geometry, with the static forces
        that act; arguments are those of :meth:`find_elasticity`.
        """
        if not self.ratio:
            return super()._list_contacts(shear, torsion, bending)
        carries = self.carries
        ratio = np.asarray(shear, float)
        shears = self.pressed_place.turn(self.shears * carries)
        return list_exact_contacts(
            self, self.forces * carries, ratio, torsion, bending, shears=shears
        )


@result_class
class PressedSample(Sample):
    """One array of balls at rest under one load that has been reached by a path of loads with
    friction.

    Attributes
    ----------
    packing, seed : as those of :class:`Sample`.
    equilibrium : the solution, in units of W and c W^(3/2).
    shear_response : tangential stiffness of contacts under sound: "slide" (eta k, none where a
        contact slides), "stick" (eta k everywhere), or "partial_slip" (``eta k (1 - |T|/mu
        f)^(1/3)``).
    """

    equilibrium: PressedEquilibrium = held(PressedEquilibrium)
    shear_response: str = held(str, default=SHEAR_RESPONSES[0])

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``shear_response`` is no choice."""
        super()._check()
        _require_response(self.shear_response)

    @property
    def rotations(self) -> Array:
        """Rotations of the balls, rad: in a plane (L1, ..., Lp) angles; in space (L1, ..., Lp, 3)
        rotation vectors. With n > 1 balls in the cell, the axis n comes after Lp.
        """
        n_balls = self.packing.structure.n_balls
        # (r, n, L1, ..., Lp), with r axes of rotation
        by_axis = self.equilibrium.rotations.reshape(n_balls, -1, *self.shape).swapaxes(0, 1)
        ordered_values = self._order(by_axis if n_balls > 1 else by_axis[:, 0])
        angles = self._units.width / self.packing.diameter * np.moveaxis(ordered_values, 0, -1)
        return angles[..., 0] if angles.shape[-1] == 1 else angles

    @property
    def tangential_forces(self) -> Array:
        """(L1, ..., Lp, n_c, p) tangential forces with which ball i acts on ball j, N; zero where
        balls are apart.
        """
        equilibrium = self.equilibrium
        p = self.packing.structure.periods
        # the forces T, which ball j exerts on ball i
        forces = equilibrium.pressed_place.turn(equilibrium.shears)[:, :p]
        by_kind = forces.reshape(-1, *self.shape, p)
        return np.asarray(-self._units.force * np.moveaxis(by_kind, 0, -2))

    @cached_property
    def network(self) -> ContactNetwork:
        """The balls, and the contacts that carry load, as a network with the springs of the linear
        response; see :attr:`Sample.network`. This network also has the tangential forces.
        """
        ratios = np.moveaxis(self.equilibrium.shear_ratios(self.shear_response), 0, -1)
        return self._make_network(ratios, self.tangential_forces)

    @property
    def tangential_ratio(self) -> float:
        """Mean ``|T|`` over the mean normal force, over all contacts."""
        return float(np.mean(self.equilibrium.contacts.shear_sizes)) / self.equilibrium.force

    @property
    def sliding_fraction(self) -> float:
        """Fraction of contacts with a tangential force at Coulomb's limit, mu f, among those that
        carry load.
        """
        return self.equilibrium.law.sliding_fraction(self.equilibrium.contacts)

    def tangential_ratio_distribution(
        self, bins: int = 50, largest: float | None = None
    ) -> tuple[Array, Array]:
        """Return the edges (bins + 1,) of bins, and the probability density (bins,) of ``|T|/f``
        over the contacts that carry load.

        The bins reach from 0 to ``largest``, by default mu, or 1 if mu is zero or above 1. Contacts
        that slide have the ratio mu. Over all ratios the density integrates to one; over the bins
        it integrates to less if there are ratios above ``largest``. Raises
        :class:`~granphon.base.errors.InputError` if ``bins`` is no whole number from 1 to a
        million, if ``largest`` is not above zero and finite, or if bins would be so narrow that
        their edges or densities are no numbers.
        """
        contacts = self.equilibrium.contacts
        mu = self.equilibrium.friction_coefficient
        ratios = self.equilibrium.law.find_ratios(contacts)[contacts.is_carrying]
        if largest is None:
            largest = mu if 0.0 < mu <= 1.0 else 1.0
        return find_density(ratios, bins, 0.0, largest)

    def mobilisation_distribution(self, bins: int = 50) -> tuple[Array, Array]:
        """Return the edges (bins + 1,) of bins from 0 to 1, and the probability density (bins,) of
        ``|T|/(mu f)`` over the contacts that carry load.

        Contacts that slide are in the last bin. Raises :class:`~granphon.base.errors.InputError` if
        mu is zero or infinite, or if ``bins`` is no whole number from 1 to a million.
        """
        equilibrium = self.equilibrium
        contacts = equilibrium.contacts
        mu = equilibrium.friction_coefficient
        if not 0.0 < mu < math.inf:
            problem = f"there is no |T|/(mu f) where mu is {mu:g}"
            why = f"Coulomb's limit mu f is {'zero' if mu == 0.0 else 'infinite'}"
            raise InputError(problem, why, "Use tangential_ratio_distribution, of |T|/f")
        mobilised = equilibrium.law.mobilise(contacts)[contacts.is_carrying]
        return find_density(mobilised, bins, 0.0, 1.0)

    @property
    def work(self) -> float:
        """Work of the load since the start, a mean over contacts, J. It is the energy that contacts
        have stored and lost since the start, and that dashpots have taken up.

        In the limit of short steps it is the integral of f over the overlap.
        """
        return self._units.energy * self.equilibrium.work

    @property
    def dissipated_energy(self) -> float:
        """Energy lost since the start, a mean over contacts, J: by sliding, by Mindlin's law, and
        to dashpots.
        """
        return self._units.energy * (
            self.equilibrium.slid + self.equilibrium.loosened + self.equilibrium.damped
        )

    @property
    def normal_stiffness(self) -> float:
        """Normal stiffness df/d(delta) of the linear response, with its springs against slip, N/m.

        It is the derivative of f while the load rises, if no contact slides and no contact that
        bears T opens; this also holds just after the load has turned upwards. It is not the slope
        of the path in general. While the load falls, the slope of the path is larger by some
        thousandths: where the normal force of a contact falls, T falls in proportion to k, which is
        not a linear response. While the load rises and contacts slide, the slope is larger by about
        a hundredth.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the linear response is not found.
        """
        return self._average_stiffness(self.elastic_tensor, self.force, self.overlap)

    @property
    def stiffness_slope(self) -> float:
        """Slope of :attr:`normal_stiffness` against the overlap as loading goes on, N/m^2; raised
        are the errors of :attr:`elastic_tensors_beside`.
        """
        f = self.force
        k = self.normal_stiffness
        # stiffnesses at loads further along the path, one and three steps of log f ahead
        stiffnesses = []
        for tensor, steps_ahead in zip(self.elastic_tensors_beside, (1.0, 3.0), strict=True):
            rise = f * math.expm1(steps_ahead * STEP)
            stiffnesses.append(self._average_stiffness(tensor, f + rise, self.overlap + rise / k))
        # d log k / d log f changes little along the path: for equal balls it is 1/3 everywhere
        exponent = math.log(stiffnesses[1] / stiffnesses[0]) / (2.0 * STEP)
        return exponent * k * k / f

    def _average_stiffness(self, tensor: Array, force: float, overlap: float) -> float:
        """Return df/d(delta), N/m: the derivative of the mean force with respect to the overlap, at
        a ``force``, N, and an ``overlap``, m, where the elastic tensor is ``tensor``, in the units
        of :attr:`elastic_tensor`.

        The derivative follows from the work of an even strain of the cell, in which only normal
        forces take part.
        """
        structure = self.packing.structure
        p = structure.periods
        d = self.packing.diameter
        even_modulus = float(np.sum(tensor[:p, :p]))
        stiffness = even_modulus * d * structure.measure / len(structure.contacts)
        if not self.is_exact:
            return stiffness
        # in the true geometry the tensor is the derivative of the stress, and the boundary on which
        # the stress acts shrinks
        spacing = d - overlap
        return stiffness * (spacing / d) ** (p - 2) - (p - 1) * force / spacing

    @cached_property
    def elastic_tensors_beside(self) -> Array:
        """(2, n, n) elastic tensors at exp(:data:`STEP`) and exp(3 STEP) times the mean force, as
        loading goes on from here.

        Loads below that of the sample would be reached by unloading, which leads to other states.
        The loading takes three steps that are equally long in log f, because the number of contacts
        that slide at the end of a step depends a little on its length; the tensors are those after
        the first and the third step.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the loading finds no balance, or a
        linear response is not found.
        """
        equilibrium = self.equilibrium
        stencils = equilibrium.sheared
        loads = [
            ReducedLoad(force=equilibrium.force * math.exp(steps * STEP))
            for steps in (1.0, 2.0, 3.0)
        ]
        geometry = PressedGeometry(stencils, equilibrium.deviations, equilibrium.ratio)
        history = LoadingHistory(
            equilibrium.deviations,
            stencils,
            equilibrium.friction_coefficient,
            tolerance=math.inf,  # steps are equally long, not halved
            geometry=geometry,
        )
        states = list(history.path(loads, equilibrium.resume()))
        neighbours = (
            PressedEquilibrium.of(state, equilibrium.deviations, stencils, equilibrium.ratio)
            for state in states[::2]
        )
        tensors = [
            self._compute_elastic_tensor(
                neighbour.share(equilibrium.deviations, equilibrium.stencils)
            )
            for neighbour in neighbours
        ]
        stencils.forget()  # Green's function is large, and the equilibrium keeps its stencils
        return read_only(tensors)

    def _find_elasticity(
        self, equilibrium: Equilibrium, torsion: Any, reduction: float | None
    ) -> Array:
        """Return the elastic tensor of an ``equilibrium`` in its own units, with the tangential
        stiffness of :attr:`shear_response`; other arguments are those of
        :meth:`Sample._find_elasticity`.
        """
        assert isinstance(equilibrium, PressedEquilibrium)
        ratios = equilibrium.shear_ratios(self.shear_response)
        return equilibrium.find_elasticity(ratios, torsion, self.packing.bending, reduction)

    def atoms(self) -> Atoms:
        """Return the sample as an ``ase.Atoms``; see :meth:`Sample.atoms`.

        ``rotations`` are the rotations of the balls since the start, rad. There are two more
        arrays. ``tangential_force`` is the mean magnitude of the tangential forces on a ball over
        the mean normal force of all contacts. ``sliding_contacts`` is the number of the contacts of
        a ball that carry load and slide. The forces of single contacts are in :attr:`network`.
        """
        balls = super().atoms()
        equilibrium = self.equilibrium
        contacts = equilibrium.contacts
        stencils = self.equilibrium.stencils
        is_sliding = contacts.is_carrying & (equilibrium.law.mobilise(contacts) >= SLIDING_RATIO)
        shape = balls.arrays["rotations"].shape
        balls.set_array("rotations", self.rotations.reshape(shape))
        tangential = self._order(stencils.average_around(contacts.shear_sizes / equilibrium.force))
        balls.set_array("tangential_force", tangential.ravel())
        balls.set_array(
            "sliding_contacts", self._order(stencils.sum_around(is_sliding.astype(int))).ravel()
        )
        balls.info["friction_coefficient"] = equilibrium.friction_coefficient
        return balls

    def respond(self, shear_response: str) -> Self:
        """Return the same sample with another ``shear_response``, the choice of the tangential
        stiffness under sound.

        Raises :class:`~granphon.base.errors.InputError` if it is none of "slide", "stick" and
        "partial_slip".
        """
        return replace(self, shear_response=_require_response(shear_response))


def _require_response(word: str) -> str:
    """Return the ``word`` if it is one of :data:`~granphon.array.options.SHEAR_RESPONSES`; raise
    :class:`~granphon.base.errors.InputError` otherwise.
    """
    return str(require("shear_response", lambda value: choice(value, SHEAR_RESPONSES), word))
