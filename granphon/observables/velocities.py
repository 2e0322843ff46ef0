"""Long waves: sound velocities (m/s), elastic moduli (Pa), and the local exponent of the velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.response import bulk_and_shear, shears
from granphon.array.sample import standard_error
from granphon.balls.lattices import as_direction
from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.media.acoustics import compute_velocities, over_directions
from granphon.media.state import ContactState, given_state, with_keyword
from granphon.observables.validity import validity

__all__ = [
    "Moduli",
    "SoundVelocities",
    "local_exponent",
    "moduli",
    "sound_velocities",
]

Array = NDArray[np.float64]


def local_exponent(state: ContactState) -> Any:
    """Return the exponent d log v / d log P of both sound velocities, with the shape of the load.

    Terms of relative order delta/d are always left out. As v goes as the root of k, and P as f, the exponent is f k'/2k^2,
    with the slope k' = dk/d(delta) of the medium's law; it is 1/6 for equal balls. With listed diameters k has a kink, and
    the exponent a spike, where the contacts between two of the diameters open.

    The moduli of a simulation are not all proportional to k. Its exponent is that of the longitudinal velocity, which
    follows from the mean K + G of the samples: the same samples are solved at two loads, 5 % below and above, and the
    difference is taken. ``state.exponent_error`` is the standard error over the samples: 0 for a medium that does not
    sample, nan for one sample. Raises :class:`~granphon.base.errors.ConvergenceError` if a simulation beside the load fails.
    """
    return given_state(state).exponent


# -- velocities and moduli ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class SoundVelocities(Result):
    """Velocities of long waves, m/s, with the shape of the load followed by that of the directions.

    Attributes
    ----------
    longitudinal : velocity of the (quasi-)longitudinal wave; None if the balls do not move along the lattice.
    transverse : velocity of the (quasi-)transverse wave in the plane; in space, and on a chain that moves both ways across
        itself, (..., 2): the slow and the fast one. None if there is none.
    direction : unit vector (p,), or (n, p).
    warnings : one sentence for each limit of the model that the state exceeds.
    longitudinal_error, transverse_error : standard errors over the samples of a simulation, m/s; None if there are fewer
        than two samples.
    out_of_plane : velocity of the wave across a plane of balls, if they move that way: zero, because it is a flexural wave.
    velocities : (..., n) of all these waves, ascending.
    polarisations : (..., n, n) their unit displacements (x, y, z, as far as the balls move), as columns.
    """

    units = {
        "longitudinal": "m/s", "transverse": "m/s", "longitudinal_error": "m/s", "transverse_error": "m/s",
        "out_of_plane": "m/s", "velocities": "m/s",
    }  # fmt: skip
    shapes = {
        "longitudinal": "...?", "transverse": "...|... 2?", "direction": "p|n p", "longitudinal_error": "...?",
        "transverse_error": "...?", "out_of_plane": "...?", "velocities": "... u?", "polarisations": "... u u?",
    }  # fmt: skip

    longitudinal: Any
    transverse: Any
    direction: Array
    warnings: tuple[str, ...]
    longitudinal_error: Any = None
    transverse_error: Any = None
    out_of_plane: Any = None
    velocities: Any = None
    polarisations: Any = None


def sound_velocities(
    state: ContactState, direction: ArrayLike | None = None, finite_overlap: bool | None = None
) -> SoundVelocities:
    """Return the sound velocities, m/s (equations 13, 14, 16): those of waves that are long against the balls.

    Parameters
    ----------
    state : the state of the contacts, at one load or many.
    direction : direction of propagation, Cartesian, (p,) for a lattice with p periods, or (n, p) for many at once, whose
        axis follows those of the load. It may be left out where sound is isotropic, as on the triangular lattice and on a
        chain. On other lattices the velocities are those of the quasi-longitudinal and the quasi-transverse waves. A
        simulation is isotropic on average: its velocities follow from its mean bulk and shear modulus.
    finite_overlap : deprecated; the state says whether overlap is finite.

    Raises
    ------
    InputError : no direction is given and velocities depend on it; a direction is not p finite numbers, or has no length.
    MechanismError : a motion of the lattice costs no energy.
    InstabilityError : with finite overlap, the lattice buckles.
    """
    state = with_keyword(state, finite_overlap)
    periods = state.packing.structure.periods
    if direction is None:
        if not state.is_isotropic:
            raise InputError(
                message(
                    f"the sound velocities of the {state.packing.structure.name} lattice depend on the direction",
                    mend=f"Give direction=({', '.join('xyz'[:periods])})",
                )
            )
        direction = np.eye(periods)[0]
    along = as_direction(direction, periods)
    names, v = state.wave_names, state.long_waves(along)
    order = np.argsort(v, axis=-1, kind="stable")
    named = {name: v[..., place] for place, name in enumerate(names)}
    if "transverse_slow" in names:
        first = names.index("transverse_slow")
        named["transverse"] = v[..., first : first + 2]
    longitudinal_error, transverse_error = None, None
    if (every := state.sampled_moduli) is not None:
        velocities = compute_velocities(every, np.asarray(state.effective_density)[..., None])
        errors = over_directions(standard_error(velocities, -2), along)
        longitudinal_error, transverse_error = np.moveaxis(errors, -1, 0)
    return SoundVelocities(
        longitudinal=named.get("longitudinal"), transverse=named.get("transverse"), direction=along,
        warnings=validity(state).warnings, longitudinal_error=longitudinal_error, transverse_error=transverse_error,
        out_of_plane=named.get("out_of_plane"), velocities=np.take_along_axis(v, order, -1),
        polarisations=np.take_along_axis(state.polarisations(along), order[..., None, :], -1),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Moduli(Result):
    """Elastic constants of the layer taken one diameter thick, Pa.

    ``tensor`` is (..., 3, 3), the shape of the load followed by the Voigt order xx, yy, xy. ``isotropic`` says whether it is
    the same in all directions; for a simulation it is True, though samples are isotropic only on average. ``bulk_error`` and
    ``shear_error`` are standard errors over the samples of a simulation, Pa; None if there are fewer than two samples.
    ``warnings`` has one sentence for each limit of the model that the state exceeds.
    """

    units = {
        "tensor": "Pa", "bulk": "Pa", "shear": "Pa", "shears": "Pa", "bulk_error": "Pa", "shear_error": "Pa",
    }  # fmt: skip
    shapes = {"tensor": "... 3 3", "bulk_error": "...?", "shear_error": "...?"}

    tensor: Array
    isotropic: bool
    warnings: tuple[str, ...]
    bulk_error: Any = None
    shear_error: Any = None

    @property
    def bulk(self) -> Any:
        """Bulk modulus K, Pa (equation 17).

        Raises :class:`~granphon.base.errors.InputError` if the lattice is not isotropic.
        """
        self._require_isotropic()
        return bulk_and_shear(self.tensor)[..., 0][()]

    @property
    def shear(self) -> Any:
        """Shear modulus G, Pa (equation 17), the mean over the two orientations of :attr:`shears`.

        Raises :class:`~granphon.base.errors.InputError` if the lattice is not isotropic.
        """
        return np.mean(self.shears, axis=-1)[()]

    @property
    def shears(self) -> Array:
        """Shear moduli of the two shears xx - yy and xy, (..., 2), Pa.

        In a sample of finite size they differ; the difference shows how far the sample is from isotropic. Raises
        :class:`~granphon.base.errors.InputError` if the lattice is not isotropic.
        """
        self._require_isotropic()
        return shears(self.tensor)

    def _require_isotropic(self) -> None:
        if not self.isotropic:
            raise InputError(message("this lattice has no single bulk and shear modulus", mend="Use .tensor"))


def moduli(state: ContactState, finite_overlap: bool | None = None) -> Moduli:
    """Return bulk and shear modulus, Pa (equation 17), or the elastic tensor of a lattice that is not isotropic.

    With finite overlap these are the coefficients between Cauchy stress and strain under the static pressure, for which
    equation (16) still holds. The keyword ``finite_overlap`` is deprecated: the state says whether overlap is finite.
    """
    state = with_keyword(state, finite_overlap)
    bulk_error, shear_error = None, None
    if (every := state.sampled_moduli) is not None:
        bulk_error, shear_error = np.moveaxis(standard_error(every, -2), -1, 0)
    return Moduli(
        tensor=state.elastic_tensor, isotropic=state.is_isotropic, warnings=validity(state).warnings,
        bulk_error=bulk_error, shear_error=shear_error,
    )  # fmt: skip
