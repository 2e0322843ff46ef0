"""Derivatives of a response with respect to the stiffnesses of contacts and the masses of balls.

The signal of a receiver is h = e^T u with Z u = F, where Z is symmetric. Let y be the adjoint
motion, the solution of Z y = e. A small change of Z and F changes the signal by y^T (dF - dZ u). So
one more solution for each receiver, with the same factors, gives the derivatives with respect to
all contacts and balls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Complex
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, result_class
from granphon.dynamics.damping import Losses
from granphon.dynamics.deformation_rows import network_unit_rows
from granphon.dynamics.sensitivities import add_static, list_inertias, name_units, sum_kinds
from granphon.waves.operator import WaveOperator

#: bytes for each derivative, with those of intermediate arrays
_BYTES = 64.0


@result_class
class ResponseSensitivities(Result):
    """Derivatives of the complex amplitudes of receivers, in the unit of the response over that of
    each parameter. Contacts and balls are those of the network, in its order.

    When a stiffness changes, the loss factor of the contact, and the viscosity of its dashpots over
    the stiffness, stay constant; when a mass changes, the rate of a drag stays constant.

    Attributes
    ----------
    normal_stiffness, shear_stiffness, torsion, bending, normal_force : (n_f, n_r, n_c) derivatives
        with respect to parameters of each contact, as in :class:`~granphon.Sensitivities`;
        ``normal_force`` is None for a network without ``prestress``.
    mass, inertia : (n_f, n_r, n) derivatives with respect to those of each ball; zero for bodies
        that are held.
    on_site : (n_f, n_r, n, motions) derivatives with respect to the stiffness of a spring that ties
        each motion of each ball to the ground; zero for bodies that are held.
    frequencies : (n_f,) Hz.
    quantity_unit : the unit of the response.
    """

    normal_stiffness: Complex = held(complex, "f r c")
    shear_stiffness: Complex = held(complex, "f r c")
    torsion: Complex = held(complex, "f r c")
    bending: Complex = held(complex, "f r c")
    mass: Complex = held(complex, "f r n")
    inertia: Complex = held(complex, "f r n")
    normal_force: Complex | None = held(complex, "f r c?")
    on_site: Complex = held(complex, "f r n a")
    frequencies: Array = held(float, "f", "Hz")
    quantity_unit: str = held(str)

    def _field_units(self) -> dict[str, str]:
        """Return the unit of each attribute, by its name; those of derivatives depend on the unit
        of the response.
        """
        return {**name_units(self.quantity_unit), **self.units}


class ResponseSlopes:
    """Finds the derivatives of responses of the network of an ``operator`` with ``losses`` from
    motions and adjoint motions, which :meth:`find` explains.

    ``source_motions`` (n, motions), m, are those of bodies that are held and that the source
    displaces; zero for all other bodies.
    """

    def __init__(self, operator: WaveOperator, losses: Losses, source_motions: Array) -> None:
        self.operator = operator
        self.losses = losses
        network = operator.network
        self.rows = network_unit_rows(network)  # of each kind of deformation
        self._deformation_matrix = operator.compose(self.rows)
        ones = [np.ones(network.n_contacts) for _ in self.rows]
        # deformations by the motions of the source alone, with the balls at their places
        self._source_deformations = operator.stretch(source_motions, (self.rows, ones))

    def require_memory(self, count: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the derivatives of ``count``
        signals fit into memory.
        """
        network = self.operator.network
        n_of_contacts = len(self.rows) * network.n_contacts
        # with respect to the mass, the inertia, and a spring to the ground for each motion
        n_of_balls = (2 + self.operator.motions.count) * network.n_balls
        require_memory(
            f"derivatives of {count:,} signals",
            _BYTES * count * (n_of_contacts + n_of_balls),
            "Take fewer frequencies or receivers",
        )

    def find(self, x: Complex, y: Complex, omega: float) -> dict[str, NDArray[Any]]:
        """Return the derivatives of the signals at ``omega``, rad/s, by the names of the fields of
        :class:`ResponseSensitivities`, without the axis of frequencies: (n_r, n_c) for contacts,
        (n_r, n) for masses and inertias, (n_r, n, motions) for springs to the ground. Without
        prestress there is none for ``normal_force``.

        ``x`` (size,) are the mass-weighted motions that the source makes, and ``y`` (size, n_r) the
        mass-weighted adjoint motions of each receiver.
        """
        return {**self._find_of_contacts(x, y, omega), **self._find_of_balls(x, y, omega)}

    def _find_of_contacts(self, x: Complex, y: Complex, omega: float) -> dict[str, NDArray[Any]]:
        """Return the derivatives (n_r, n_c) with respect to parameters of contacts at ``omega``,
        rad/s, by the names of fields. ``x`` and ``y`` are those of :meth:`find`.
        """
        network = self.operator.network
        deformations = self._deformation_matrix @ x + self._source_deformations
        adjoint_deformations = np.asarray(self._deformation_matrix @ y)
        # a signal changes by -y^T (dK/dk) x: minus the product of both deformations of the contact,
        # times its losses
        products: Any = deformations[:, None] * adjoint_deformations
        sums = sum_kinds(self.rows, products)
        zeros = np.zeros((network.n_contacts, y.shape[1]))  # of kinds that no motion makes
        # complex stiffness over the stiffness, (n_c,), in normal motion and in all other motion
        normal_factor, other_factor = 1.0 + 1j * (self.losses.factors + omega * self.losses.times)
        fields: dict[str, NDArray[Any]] = {}
        for name, factor in (
            ("normal_stiffness", normal_factor),
            ("shear_stiffness", other_factor),
            ("torsion", other_factor),
            ("bending", other_factor),
        ):
            fields[name] = (-factor[:, None] * sums.get(name, zeros)).T
        if network.prestress:
            # a force f that presses adds -(f/r) B^T B to the stiffness: two signs cancel
            pushes = sums.get("normal_force", zeros) / network.distance[:, None]
            fields["normal_force"] = pushes.T
            by_growth = -sums.get("tangential_growth", zeros).T
            by_excess = -sums.get("excess", zeros).T
            add_static(fields, network, by_growth, by_excess)
        return fields

    def _find_of_balls(self, x: Complex, y: Complex, omega: float) -> dict[str, NDArray[Any]]:
        """Return the derivatives with respect to masses and inertias (n_r, n) and to springs to the
        ground (n_r, n, motions) at ``omega``, rad/s, by the names of fields; zero for balls that do
        not move. ``x`` and ``y`` are those of :meth:`find`.
        """
        operator = self.operator
        network = operator.network
        motions = operator.motions
        moving = operator.balls
        products = operator.values(x[:, None] * y)  # (n_free, motions, n_r), mass-weighted
        on_site = np.zeros((y.shape[1], network.n_balls, motions.count), complex)
        on_site[:, moving] = -np.moveaxis(products, 2, 0) / list_inertias(network)[moving]
        # a mass enters Z by the factor i omega drag - omega^2, a spring to the ground by 1
        by_inertia = (1j * omega * self.losses.drag_of(motions) - omega**2) * on_site
        return {
            "on_site": on_site,
            "mass": by_inertia[..., motions.translating].sum(axis=-1),
            "inertia": by_inertia[..., motions.turning].sum(axis=-1),
        }
