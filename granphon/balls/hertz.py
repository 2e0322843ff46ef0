"""The contact of two elastic balls: Hertz's normal force, and Mindlin's shear stiffness under a
tangential load.

Equations (1)-(4) of Velicky and Caroli, Phys. Rev. E 65, 021307 (2002), with the harmonic mean
diameter d*.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.material import Material
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.validation import positive, real_array

#: a of Hertz's law f = c h_+^a, with the overlap h; the stiffness is a f/h, and the energy is
#: f h/(a + 1)
EXPONENT = 1.5
#: orders of the derivatives of the energy with respect to the overlap: energy, force, stiffness,
#: slope of the stiffness
ENERGY, FORCE, STIFFNESS, SLOPE = range(4)
#: the names of these derivatives in messages
QUANTITIES = ("energy", "force", "stiffness", "slope of the stiffness")
#: d log omega / d log f of equal balls, (a - 1)/2a = 1/6, as frequencies go as k^(1/2)
FREQUENCY_EXPONENT = (EXPONENT - 1.0) / (2.0 * EXPONENT)
#: the pressure is high (low) where the overlap is above (below) Delta_rms by this factor or more;
#: half a decade is what "much larger" is taken to mean
HIGH_PRESSURE_RATIO = math.sqrt(10.0)
#: largest radius of a contact, over that of the balls, up to which it is the small spot that
#: Hertz's law assumes
MOST_CONTACT_RADIUS = 0.1
#: force of a contact, over the mean of all, above which it is counted as one that carries load: a
#: convention, as the places of balls that are held more weakly are not unique
COUNTED_FORCE = 1e-6
#: stiffness of a contact, over that under the mean force, up to which the contact counts as holding
#: no ball: a ball that softer contacts alone hold has frequencies below a twentieth of those of
#: others
_HOLDING_STIFFNESS = 2e-3
#: the force of such a contact over the mean, as stiffness goes as f^(1/3)
HOLDING_FORCE = _HOLDING_STIFFNESS ** (EXPONENT / (EXPONENT - 1.0))
#: why loads of contacts that do not adhere are refused below zero, and at zero
NO_TENSION = "One-sided contacts carry no tension"
NO_STIFFNESS = "Balls that only touch have no stiffness, and carry no sound"
#: least normal number of double precision; smaller numbers have lost digits
LEAST_NORMAL = np.finfo(float).tiny


def mindlin_reduction(
    tangential_load: ArrayLike, normal_load: ArrayLike, friction_coefficient: float
) -> Any:
    """Return the factor by which a static tangential load T reduces the shear stiffness of a
    contact under normal load N, of the shape to which both broadcast.

    The factor is (1 - T / mu N)^(1/3), for a tangential load that has grown from zero at constant
    normal load (R. D. Mindlin, J. Appl. Mech. 16, 259, 1949). The text after equation (4) prints
    1 - (T / mu N)^(1/3) instead: see the errata.

    ``tangential_load`` T and ``normal_load`` N are in the same unit, of any shapes that broadcast;
    the sign of T does not matter. ``friction_coefficient`` is mu, a pure number.

    Raises :class:`InputError` where the contact would slide (T >= mu N) or is not under
    compression; for loads that are no finite numbers, or whose shapes do not broadcast; and for a
    coefficient that is not finite and above zero.
    """
    mu = positive("friction_coefficient", friction_coefficient)
    signed_load, normal = read_broadcast(tangential_load=tangential_load, normal_load=normal_load)
    tangential = np.abs(signed_load)
    is_finite = bool(np.all(np.isfinite(tangential)) and np.all(np.isfinite(normal)))
    is_compressive = bool(np.all(normal > 0.0))
    if not (is_finite and is_compressive):
        raise InputError(
            "a load on the contact is not finite, or its normal part is not compressive",
            mend="Give finite loads, and a normal_load above zero",
        )
    # mantissas and exponents apart: products of loads may leave the floating range where their
    # quotient does not
    mantissa_of_mu, power_of_mu = np.frexp(mu)
    mantissa_of_load, power_of_load = np.frexp(normal)
    with np.errstate(over="ignore", under="ignore"):
        scaled_load = np.ldexp(tangential, -(power_of_load + power_of_mu))
        mobilised = scaled_load / (mantissa_of_mu * mantissa_of_load)
    if np.any(mobilised >= 1.0):
        raise InputError(
            f"the tangential load is {float(np.max(mobilised)):.6g} of the friction threshold",
            "At 1 the contact slides, and has no shear stiffness",
            "Lower the tangential_load, or raise the normal_load",
        )
    return reduce_by_slip(mobilised)[()]


def reduce_by_slip(mobilised: ArrayLike) -> Any:
    """Return the part of the shear stiffness that partial slip leaves, (1 - T/mu N)^(1/3), of
    contacts whose ``mobilised`` part of the friction is T/mu N, from 0 to 1.
    """
    return np.cbrt(1.0 - np.asarray(mobilised))


def read_broadcast(**arguments: ArrayLike) -> list[Array]:
    """Return the ``arguments``, real numbers or arrays of such, as arrays of the one shape to which
    all broadcast; these may share memory with the arguments, and are not to be written to.

    Raises :class:`InputError` for what is no number, and for shapes that do not broadcast.
    """
    arrays = {name: real_array(name, value) for name, value in arguments.items()}
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(
            f"these shapes do not fit together: {shapes}",
            mend="Give arrays of one shape, or single numbers",
        ) from None


def harmonic_diameter(first: ArrayLike, second: ArrayLike) -> Any:
    """Return the harmonic mean diameter d*, m, of two balls of the diameters ``first`` and
    ``second``, m, above zero: 1/d* = (1/d_i + 1/d_j)/2 (equation 3). The diameters broadcast; where
    twice the larger is beyond double precision, the result may be zero, infinite or nan.

    Raises :class:`InputError` for what is no number, and for shapes that do not broadcast.
    """
    first_diameter, second_diameter = read_broadcast(diameter=first, other_diameter=second)
    with np.errstate(over="ignore", invalid="ignore"):
        return (2.0 * first_diameter / (first_diameter + second_diameter) * second_diameter)[()]


def contact_radius_ratio(overlap: ArrayLike, diameter: ArrayLike) -> Any:
    """Return the radius of the contact circle over the radius of the balls, (delta/d)^(1/2), for
    equal balls of ``diameter`` d, m, above zero, with an ``overlap`` delta, m, zero or above. Both
    broadcast. Raises :class:`InputError` for what is no number, and for shapes that do not
    broadcast.
    """
    delta, d = read_broadcast(overlap=overlap, diameter=diameter)
    return np.sqrt(delta / d)[()]


def high_pressure_overlap(width: float) -> float:
    """Return the overlap, m, from which on the pressure is high (Section III), for balls whose
    diameters have the ``width`` W, m.
    """
    return HIGH_PRESSURE_RATIO * width / math.sqrt(12.0)


class EnergyLaw(ABC):
    """A contact law that is known by its energy and the derivatives of the energy with respect to
    the overlap.

    Methods take scalars or arrays of any shape, and return floats for floats. They raise
    :class:`InputError` for what is no real number, for nan, and where the result is no finite
    number; an overlap of minus infinity is that of balls far apart, where the law is zero unless it
    pulls at any distance.
    """

    @property
    def least_overlap(self) -> float:
        """Overlap below which the bodies are apart, m."""
        return 0.0

    @abstractmethod
    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap``, m, unchecked; zero where the bodies are apart.
        """

    def _press(self, overlap: Array) -> tuple[Array, Array]:
        """Return the force, N, and the stiffness, N/m, at each ``overlap``, m, unchecked."""
        return self._evaluate(overlap, FORCE), self._evaluate(overlap, STIFFNESS)

    def _find(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap``, m; raise :class:`InputError` for what is no real number, for nan, and where the
        result is no finite number.
        """
        delta = real_array("overlap", overlap)
        with np.errstate(all="ignore"):  # numbers that are not finite are refused below
            derivative = self._evaluate(delta, order)
        # balls that are apart have zero whatever their distance, but nan is refused
        number_to_check = np.where(np.isnan(delta), delta, derivative)
        require_finite(QUANTITIES[order], number_to_check, "an overlap", delta, "m")
        return derivative

    def energy(self, overlap: ArrayLike) -> Any:
        """Return the energy of a contact at an ``overlap``, m, in J; its derivative is the
        force.
        """
        return self._find(overlap, ENERGY)

    def force(self, overlap: ArrayLike) -> Any:
        """Return the force f at an ``overlap``, m, in N."""
        return self._find(overlap, FORCE)

    def stiffness(self, overlap: ArrayLike) -> Any:
        """Return the stiffness k = df/d(delta) at an ``overlap``, m, in N/m."""
        return self._find(overlap, STIFFNESS)

    def stiffness_slope(self, overlap: ArrayLike) -> Any:
        """Return the slope of the stiffness, dk/d(delta), at an ``overlap``, m, in N/m^2."""
        return self._find(overlap, SLOPE)


def read_overlap(overlap: ArrayLike) -> Array:
    """Return each ``overlap``, m, in an array; :class:`InputError` for what is no real number, and
    for nan. An infinite overlap is a number: balls may be apart by any distance.
    """
    delta = real_array("overlap", overlap)
    if np.any(np.isnan(delta)):
        raise InputError("an overlap is nan", mend="Give a number, m")
    return delta


def require_finite(name: str, quantity: Any, cause: str, argument: Any, unit: str) -> None:
    """Raise :class:`InputError` unless all numbers of a ``quantity`` of contacts are finite.

    The message calls the quantity ``name``, and gives the first ``argument`` with a number that is
    not finite, or says that this argument is nan: ``cause`` is what the argument is, ``unit`` its
    unit. ``quantity`` and ``argument`` are of one shape.
    """
    is_finite = np.isfinite(quantity)
    if not np.all(is_finite):
        first_index = np.argmin(np.ravel(is_finite))
        number = float(np.ravel(argument)[first_index])
        if math.isnan(number):
            raise InputError(f"{cause} is nan", mend=f"Give a number, {unit}")
        raise InputError(
            f"the {name} of a contact at {cause} of {number:g} {unit} is beyond double precision",
            mend="Compare the units",
        )


def require_pushing(forces: Array, least: float = 0.0) -> None:
    """Raise :class:`InputError` unless all ``forces``, N, are the ``least`` that a contact bears,
    N, or more; a negative ``least`` is a tension.
    """
    if np.any(np.isnan(forces)):
        raise InputError("the force of a contact is nan", mend="Give a number, N")
    if not np.all(forces >= least):
        problem = "the force of a contact is negative"
        why = NO_TENSION
        if least != 0.0:
            problem = f"a contact is pulled by more than {-least:.6g} N"
            why = "That is what its adhesion bears"
        raise InputError(problem, why, f"Give f >= {least + 0.0:.6g}")  # -0.0 becomes 0.0


@dataclass(frozen=True)
class HertzLaw(EnergyLaw):
    """Hertz's law f = c delta_+^(3/2): the force between two balls pressed together, zero when they
    are apart.

    Parameters
    ----------
    coefficient : c = (2/3) E* d*^(1/2), N/m^(3/2) (equations 1 and 22).

    All methods take scalars or arrays, and return floats for floats; what they raise is said in
    :class:`EnergyLaw`. The energy of a contact is
    (2/5) c delta_+^(5/2), the force c delta_+^(3/2) (equation 22, the inverse of 1), the normal
    stiffness (3/2) c delta_+^(1/2) (equation 2), and its derivative by the overlap (3/4) c
    delta^(-1/2), zero where the balls are apart.

    Raises
    ------
    InputError : a coefficient that is not a finite number above zero.
    """

    coefficient: float

    def __post_init__(self) -> None:
        """Check the coefficient, and keep it as a plain float."""
        object.__setattr__(
            self, "coefficient", positive("coefficient", self.coefficient, "N/m^(3/2)")
        )

    @classmethod
    def between(cls, material: Material, first: float, second: float | None = None) -> HertzLaw:
        """Return the law of two balls of one material with the diameters ``first`` and ``second``,
        m; of equal balls if only one is given. Raises :class:`InputError` for an argument that is
        no material, a diameter that is not a finite number above zero, and balls beyond double
        precision.
        """
        if not isinstance(material, Material):
            problem = f"the material of a contact is {brief(material)}"  # type: ignore[unreachable]
            raise InputError(problem, mend="Give a granphon.Material")
        first_diameter = positive("diameter", first, "m")
        second_diameter = first_diameter if second is None else positive("diameter", second, "m")
        mean_diameter = float(harmonic_diameter(first_diameter, second_diameter))
        coefficient = 2.0 / 3.0 * material.contact_modulus * math.sqrt(mean_diameter)
        if not 0.0 < coefficient < math.inf:
            raise InputError(
                f"balls of {first_diameter:g} m and {second_diameter:g} m of this material"
                f" are beyond double precision",
                mend="Compare the units",
            )
        return cls(coefficient)

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy (2/5) c delta^(5/2), J, or its derivative of an ``order`` of 1 to 3,
        J/m^order, at each ``overlap`` delta, m.
        """
        delta = np.maximum(overlap, 0.0)
        root = np.sqrt(delta)
        if order == ENERGY:
            return (0.4 * self.coefficient * delta * root * delta)[()]
        if order == FORCE:
            return (self.coefficient * delta * root)[()]
        if order == STIFFNESS:
            return (1.5 * self.coefficient * root)[()]
        slope = np.zeros_like(root)
        np.divide(0.75 * self.coefficient, root, out=slope, where=root > 0.0)
        return slope[()]

    def _press(self, overlap: Array) -> tuple[Array, Array]:
        """Return the force c delta_+^(3/2), N, and the stiffness (3/2) c delta_+^(1/2), N/m, at
        each ``overlap`` delta, m, with one root for both.
        """
        delta = np.maximum(overlap, 0.0)
        root = np.sqrt(delta)
        return self.coefficient * delta * root, 1.5 * self.coefficient * root

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap delta = (f/c)^(2/3), m, under a ``force`` f, N (equation 1).

        Raises :class:`InputError` if a force is negative or nan, or if an overlap is beyond double
        precision.
        """
        forces = real_array("force", force)
        require_pushing(forces)
        with np.errstate(over="ignore"):
            ratio = forces / self.coefficient
        has_all_digits = (ratio >= LEAST_NORMAL) & (ratio < np.inf)
        cube_root = np.cbrt(ratio)
        # where the quotient leaves the range of normal numbers, that of the roots does not
        if not np.all(has_all_digits):
            quotient_of_roots = np.cbrt(forces) / np.cbrt(self.coefficient)
            cube_root = np.where(has_all_digits, cube_root, quotient_of_roots)
        delta = cube_root**2
        require_finite("overlap", delta, "a force", forces, "N")
        return delta[()]

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Return the relative fluctuation Delta f / f of the forces over balls: zero at any
        ``overlap`` of equal balls. Raises :class:`InputError` for what is no real number, and for
        nan.
        """
        return np.zeros_like(read_overlap(overlap))[()]

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of the contacts that carry load, at each ``overlap``, m: 1 above
        zero, else 0. Raises :class:`InputError` for what is no real number, and for nan.
        """
        return np.asarray(read_overlap(overlap) > 0.0, float)[()]

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which on the law may be used for balls whose diameters have
        the ``width`` W, m: the force at :func:`high_pressure_overlap`.
        """
        return float(self.force(high_pressure_overlap(width)))


# -- the law in reduced units, in which c = 1: without checks, for loops over large arrays --------


def press(overlap: Array) -> tuple[Array, Array]:
    """Return the forces h_+^(3/2) and the roots h_+^(1/2) of contacts with the ``overlap`` h, in
    reduced units and of the same shape; both are zero where h < 0.
    """
    positive_overlap = np.maximum(overlap, 0.0)
    root = np.sqrt(positive_overlap)
    return np.multiply(positive_overlap, root, out=positive_overlap), root


def press_further(
    overlap: float, differences: Array, out: Array | None = None
) -> tuple[Array, Array]:
    """Return the changes of force h_+^(3/2) - y_+^(3/2) of contacts whose overlaps change from one
    ``overlap`` y to h = y + ``differences``, and the roots h_+^(1/2); both have the shape of the
    ``differences``, and all are in reduced units.

    No digits are lost by subtraction. The changes are written to ``out``, if it is given.
    """
    closed_overlap = max(overlap, 0.0)  # y_+
    change = np.maximum(differences, -overlap, out=out)  # becomes h_+ - y_+
    if overlap < 0.0:
        change += overlap
    root = change + closed_overlap
    np.sqrt(root, out=root)
    if closed_overlap == 0.0:
        change *= root
        return change, root
    # the difference of the powers 3/2, over that of h and y, is h^(1/2) + y/(h^(1/2) + y^(1/2))
    factor = root + math.sqrt(closed_overlap)
    np.divide(closed_overlap, factor, out=factor)
    factor += root
    change *= factor
    return change, root


def release(rest: Array, rest_root: Array, elongation: Array, out: tuple[Array, Array]) -> None:
    """Write to the two arrays ``out`` the losses of force y^(3/2) - h_+^(3/2), and the roots
    h_+^(1/2), of contacts whose overlaps fall from ``rest`` y >= 0 by an ``elongation`` e to
    h = y - e.

    All arrays have one shape and are in reduced units. No digits are lost by subtraction.
    ``rest_root`` is y^(1/2), and the least number above zero where y is zero, so that no quotient
    is 0/0.
    """
    loss, root = out
    np.minimum(elongation, rest, out=loss)  # y - h_+, which the factor makes a loss of force
    np.subtract(rest, loss, out=root)
    np.sqrt(root, out=root)
    # the factor becomes the quotient of press_further, h_+^(1/2) + y/(h_+^(1/2) + y^(1/2))
    factor = root + rest_root
    np.divide(rest, factor, out=factor)
    factor += root
    loss *= factor


def stretch(rest: Array, rest_root: Array, elongation: Array) -> Array:
    """Return, for contacts whose overlaps fall from ``rest`` y >= 0 by an ``elongation`` e to
    h = y - e, the change (2/5) (h_+^(5/2) - y^(5/2)) of the stored energy plus the work y^(3/2) e
    of the force at rest. The terms linear in e cancel, so that the result begins with e^2.

    All arrays have one shape; ``rest_root`` is that of :func:`release`.
    """
    root = np.sqrt(np.maximum(rest - elongation, 0.0))
    # g = h_+^(1/2) - r with r = y^(1/2): the energy (2/5) h^(5/2) is a polynomial of g, nested here
    root_change = -np.minimum(elongation, rest) / (root + rest_root)
    quadratic_factor = 2.0 * rest_root + 0.4 * root_change
    linear_factor = 4.0 * rest_root**2 + root_change * quadratic_factor
    energy = root_change * root_change * (3.0 * rest_root**3 + root_change * linear_factor)
    # beyond the opening the contact has no force, but the work of the force at rest goes on
    return np.asarray(energy - rest_root**3 * np.minimum(rest - elongation, 0.0))


def mean_force(overlap: Array, other: Array) -> Array:
    """Return the mean of h_+^(3/2) on the straight way from each ``overlap`` h to the ``other``:
    the change of (2/5) h_+^(5/2) over that of h; all arrays have one shape.
    """
    root = np.sqrt(np.maximum(overlap, 0.0))
    other_root = np.sqrt(np.maximum(other, 0.0))
    sum_of_roots = root + other_root
    closed_change = (other_root - root) * sum_of_roots  # of h_+
    change = other - overlap
    # the part of the way on which the contact is closed: 1, unless the contact opens or closes
    closed_part = np.ones_like(change)
    has_switched = (overlap < 0.0) != (other < 0.0)
    np.divide(closed_change, change, out=closed_part, where=has_switched)
    # the mean between r^2 and s^2 is (2/5) (s^5 - r^5)/(s^2 - r^2), without differences of near
    # numbers: the sum of r^(4 - k) s^k over r + s
    a = root * root
    b = other_root * other_root
    powers = a * a + b * b + root * other_root * (a + b) + a * b
    mean_while_closed = np.zeros_like(sum_of_roots)
    np.divide(powers, sum_of_roots, out=mean_while_closed, where=sum_of_roots > 0.0)
    return np.asarray(0.4 * closed_part * mean_while_closed)


def force_of(overlap: Any) -> Any:
    """Return the force h_+^(3/2) of a contact with the ``overlap`` h, in reduced units; zero where
    h < 0.
    """
    return np.maximum(overlap, 0.0) ** EXPONENT


def overlap_of(force: Any) -> Any:
    """Return the overlap f^(2/3) of a contact under the ``force`` f >= 0, in reduced units."""
    return np.cbrt(force) ** 2


def energy_of(force: Any, overlap: Any) -> Any:
    """Return the energy (2/5) f h of contacts with the ``force`` f and the ``overlap`` h >= 0, in
    any units.
    """
    return 0.4 * force * overlap


def stiffness_of(root: Any) -> Any:
    """Return the stiffness (3/2) h^(1/2), in reduced units, of a contact with the ``root`` h^(1/2)
    of its overlap; for a sum of roots, return the sum of the stiffnesses.
    """
    return EXPONENT * root


def slope_of(root: Array) -> Array:
    """Return the slope (3/4) h^(-1/2) of the stiffness, in reduced units, of contacts with the
    ``root`` h^(1/2) of their overlap; zero where the root is zero and balls are apart.
    """
    return np.divide(0.75, root, out=np.zeros_like(root), where=root > 0.0)


def stiffness_under(force: Any) -> Any:
    """Return the stiffness (3/2) f^(1/3) of a contact under the ``force`` f, in reduced units."""
    return EXPONENT * np.cbrt(force)


def overlap_from(force: Any, stiffness: Any) -> Any:
    """Return the overlap (3/2) f/k of a contact with the force f and the stiffness k, in any
    units.
    """
    return EXPONENT * force / stiffness
