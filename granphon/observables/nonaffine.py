"""Non-affine motions: how each ball moves beside a uniform strain of the cell, until no force is
left on it.

A ball at x moves by e x + u under the strain e. In a lattice with one ball in its cell u is zero.
In a disordered packing u is as large as e times a diameter, or larger where contacts are few. The
elastic moduli are those of the whole motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.layers import find_axes
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.text import counted
from granphon.base.validation import finite_array
from granphon.dynamics.elasticity import voigt_names, voigt_pairs
from granphon.media.state import as_state
from granphon.networks.network import ContactNetwork, given_network


@result_class
class NonaffineMotion(Result, array="displacements"):
    """Motions of balls beside those of a strain; ``np.asarray`` of it is ``displacements``.

    Attributes
    ----------
    strain : (s,) the strain in Voigt order, as that of :attr:`Moduli.components`; a shear strain is
        that of the angle.
    displacements : (n, 3) of each ball for this strain, to first order, m; zero of bodies that do
        not move. If all balls move, the mean over the balls is zero.
    rotations : (n, 3) of each ball for this strain, to first order, rad; zero of bodies that do not
        move, and of balls that do not turn.
    """

    strain: Array = held(float, "s")
    displacements: Array = held(float, "n 3", "m")
    rotations: Array = held(float, "n 3", "rad")

    @property
    def sizes(self) -> Array:
        """(n,) lengths of the displacements, m."""
        return np.asarray(np.linalg.norm(self.displacements, axis=1))


def find_nonaffine(
    x: Any, strain: ArrayLike | None = None, *, progress: Progress = silent
) -> NonaffineMotion:
    """Return the non-affine motions of the balls of ``x``, a network with periods, a state or a
    sample, under the ``strain``, to first order: they are proportional to it.

    Parameters
    ----------
    x : a :class:`~granphon.ContactNetwork`, a state of a medium at one load, or a sample.
    strain : (1,), (3,) or (6,) in Voigt order, along the axes of the moduli; by default a shear of
        the first two axes by an angle of one, and on a line an extension of one.
    progress : is told how far the relaxation of many balls has come.

    Raises :class:`~granphon.base.errors.InputError` for a strain that is no numbers, of another
    shape or not finite, for a state of several loads or of samples, each of which has a network of
    its own, and for a ``progress`` without a method ``step``; and what :func:`~granphon.moduli`
    raises.
    """
    state = as_state(x)
    require_progress(progress)
    network = given_network(x)
    lattice = state.contact_lattice()
    lattice.require_motions_along()
    p = lattice.periods
    voigt = _read_strain(strain, p)
    state.relax_inner_motions(progress)
    lattice.require_rigid(state.scales)
    # of all components of the displacement those along the periods, which come first, are strained
    gradients = np.zeros((len(lattice.motions.translations), p))
    gradients[:p] = _make_strain(voigt, p)
    # (balls, motions), reduced: the motions beside the displacements that the strain itself makes,
    # summed over the components of the gradient
    motions = np.einsum("bmg,g->bm", lattice.gradient_motions, gradients.ravel())
    displacements, rotations = _spread_motions(motions, network, state)
    return NonaffineMotion(voigt, displacements, rotations)


def _read_strain(strain: ArrayLike | None, periods: int) -> Array:
    """Return the components of a strain of p ``periods`` in Voigt order, by default the last one
    alone, of one; InputError for another number of components or one that is not finite.
    """
    names = voigt_names(periods)
    if strain is None:
        return np.asarray(np.eye(len(names))[-1])
    voigt = finite_array("strain", strain)
    if voigt.shape != (len(names),):
        fault = f"the strain has the shape {voigt.shape}"
        raise InputError(fault, mend=f"Give {counted(len(names), 'number')}: {', '.join(names)}")
    return voigt


def _spread_motions(motions: Array, network: ContactNetwork, state: Any) -> tuple[Array, Array]:
    """Return the displacements, m, and the rotations, rad, (n, 3) each, of all n balls of a
    ``network`` along its axes, from the reduced ``motions`` (balls, motions) of the balls that move
    in the lattice of the ``state``. Both are zero of balls that do not move; if all balls move, the
    mean displacement is subtracted.
    """
    lattice = state.contact_lattice()
    translation_axes = list(lattice.motions.translations)
    rotation_axes = list(lattice.motions.rotations)
    n_translations = len(translation_axes)
    # the lattice may be turned, so that its periods lie along x, or in the xy plane
    frame = np.eye(3)
    dimension = network.dimension
    periods = network.cell[np.flatnonzero(network.pbc), :dimension]
    frame[:dimension, :dimension] = find_axes(periods)
    displacements = np.zeros((network.n_balls, 3))
    rotations = np.zeros((network.n_balls, 3))
    rows = np.flatnonzero(network.moving)[:, None]
    displacements[rows, translation_axes] = state.scales.length * motions[:, :n_translations]
    if np.all(network.moving):
        displacements -= np.mean(displacements, axis=0)
    # a rotation phi is stored as the length R_g phi, with the radius of gyration R_g of the ball
    rotations[rows, rotation_axes] = motions[:, n_translations:] / lattice.gyration[:, None]
    return displacements @ frame, rotations @ frame


def _make_strain(voigt: Array, periods: int) -> Array:
    """Return the symmetric strain tensor (p, p) of p ``periods`` from the components ``voigt`` in
    Voigt order: the diagonal of the tensor, and then the angles of shear, which are twice its other
    components.
    """
    strain = np.zeros((periods, periods))
    for (a, b), component in zip(voigt_pairs(periods), voigt.tolist(), strict=True):
        # each pair of different axes stands once, for two entries
        strain[a, b] += 0.5 * component
        strain[b, a] += 0.5 * component
    return strain
