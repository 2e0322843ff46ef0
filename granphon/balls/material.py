"""The material of the balls: its elastic constants, and what follows from them for contacts and
waves.

Equations (3) and (4) of Velicky and Caroli, Phys. Rev. E 65, 021307 (2002), where E* = E / 2(1 -
sigma^2).
"""

from __future__ import annotations

import math
from typing import Any

from granphon.base.errors import Refused
from granphon.base.quantities import DENSITY, MODULUS
from granphon.base.settings import Block, Kind, setting, with_unit
from granphon.base.text import show
from granphon.base.validation import positive, real_number

#: Young's modulus, Pa, below that of any solid that keeps its shape; a smaller one was probably
#: given in a wrong unit
LEAST_YOUNG_MODULUS = 1e3
#: density, kg/m^3, below which no ball is but of foam; a smaller number was probably given in
#: g/cm^3, in which the densest solid, osmium, has 22.6
LEAST_DENSITY = 20.0
#: mean pressure of a contact over the yield strength at which it begins to yield: the largest
#: pressure is then 1.6 of the yield strength, and the mean of a Hertz contact is 2/3 of the largest
ONSET_OF_YIELD = 1.07
#: omega R / v_T of the torsional mode of order two of a free sphere: the least positive root of x
#: j_2'(x) = j_2(x)
_TORSIONAL_FREQUENCY = 2.501132620409395
#: number of terms of the series of the breathing mode: the last is far below rounding
_BREATHING_TERMS = 20


def read_poisson_ratio(value: Any) -> float:
    """Read a Poisson ratio sigma (a rule): that of a stable isotropic solid, -1 < sigma <= 1/2."""
    ratio = real_number(value)
    if -1.0 < ratio <= 0.5:
        return ratio
    allowed = "a plain number, -1 < poisson_ratio <= 0.5"
    if isinstance(value, str):
        raise Refused(show(value), allowed, "Write it without quotes or unit.")
    if math.isnan(ratio):
        raise Refused(show(value), allowed)
    mend = "Outside it an isotropic elastic solid is not stable."
    raise Refused(show(value), allowed, mend)


class Material(Block):
    """An elastic, isotropic material.

    Parameters
    ----------
    young_modulus : E, Pa.
    poisson_ratio : sigma, -1 < sigma <= 1/2.
    density : rho, kg/m^3.
    yield_strength : uniaxial yield stress, Pa; optional, used only to say where the contact would
        yield.

    Raises
    ------
    InputError : a value that is no number, not finite or out of range.
    """

    young_modulus: float = setting(
        with_unit(MODULUS), "Young modulus of the material", title="Young modulus"
    )
    poisson_ratio: float = setting(
        Kind.plain(read_poisson_ratio, float),
        "Poisson ratio of the material",
        title="Poisson ratio",
    )
    density: float = setting(
        with_unit(DENSITY), "density of the material, not of the packing", title="density"
    )
    yield_strength: float | None = setting(
        with_unit(MODULUS),
        "uniaxial yield stress; you are warned where contacts would flow",
        default=None,
        absent="none: not checked",
        title="yield strength",
    )

    @property
    def contact_modulus(self) -> float:
        """Contact modulus E* = E / 2(1 - sigma^2), Pa (equation 3)."""
        # (1 - sigma)(1 + sigma) loses no digits near sigma = -1, where 1 - sigma^2 would
        return self.young_modulus / (2.0 * (1.0 - self.poisson_ratio) * (1.0 + self.poisson_ratio))

    @property
    def mindlin_ratio(self) -> float:
        """Ratio eta = 2(1 - sigma)/(2 - sigma) of the shear to the normal stiffness of a contact
        (equation 4).
        """
        return 2.0 * (1.0 - self.poisson_ratio) / (2.0 - self.poisson_ratio)

    def ball_mass(self, diameter: float) -> float:
        """Return the mass of a ball of a ``diameter`` d, m, pi rho d^3 / 6, kg (equation 7); it is
        zero below the floating range and infinite above. Raises InputError for a diameter that is
        not a finite number above zero.
        """
        d = positive("diameter", diameter, "m")
        return math.pi / 6.0 * self.density * d * d * d

    @property
    def shear_modulus(self) -> float:
        """Shear modulus E / 2(1 + sigma), Pa."""
        return self.young_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def transverse_velocity(self) -> float:
        """Bulk velocity (G/rho)^1/2 of transverse waves in the material, m/s."""
        # the quotient may be beyond the floating range
        return math.sqrt(self.shear_modulus) / math.sqrt(self.density)

    @property
    def longitudinal_velocity(self) -> float:
        """Bulk velocity of longitudinal waves in the material, m/s; infinite at sigma = 1/2."""
        sigma = self.poisson_ratio
        if sigma == 0.5:
            return math.inf
        return self.transverse_velocity * math.sqrt(2.0 * (1.0 - sigma) / (1.0 - 2.0 * sigma))

    def lowest_resonance(self, diameter: float) -> float:
        """Return the frequency of the lowest free vibration of a ball of this material, Hz, of a
        ``diameter``, m; it is infinite above the floating range.

        The vibration is the torsional mode of order two or the breathing mode of a free elastic
        sphere, whichever is lower (H. Lamb, Proc. London Math. Soc. 13, 189, 1882). Raises
        InputError for a diameter that is not a finite number above zero.
        """
        # v_T / 2 pi R; the least diameters have no half within the floating range
        frequency_unit = self.transverse_velocity / (math.pi * positive("diameter", diameter, "m"))
        sigma = self.poisson_ratio
        # the torsional mode is the same for every sigma, and the lowest except in strongly auxetic
        # materials, where the breathing mode falls to zero with the bulk modulus; the spheroidal
        # mode of order two lies between
        if sigma >= 0.0:
            return _TORSIONAL_FREQUENCY * frequency_unit
        breathing_frequency = _find_breathing_mode(sigma)
        reduced_frequency = (
            _TORSIONAL_FREQUENCY if breathing_frequency is None else breathing_frequency
        )
        return reduced_frequency * frequency_unit


def _find_breathing_mode(sigma: float) -> float | None:
    """Return omega R/v_T of the breathing mode of a free elastic sphere of Poisson ratio ``sigma``
    below zero; None if the torsional mode of order two is lower.
    """
    from scipy.optimize import brentq

    ratio_squared = (1.0 - 2.0 * sigma) / (2.0 * (1.0 - sigma))  # (v_T / v_L)^2
    # the mode is the root of tan(y)/y = 1/(1 - y^2 v_L^2/4 v_T^2), with y^2 = r x^2 and r =
    # ``ratio_squared``. Multiplied out to r j_1(y)/y - j_0(y)/4 the function has no pole. It is
    # summed as a series in y^2. Its first coefficient is a difference that vanishes at sigma = -1,
    # and is given in closed form
    first_coefficient = -(1.0 + sigma) / (12.0 * (1.0 - sigma))
    coefficients = []
    for k in range(1, _BREATHING_TERMS):
        j1_coefficient = ratio_squared * (2 * k + 2) / math.factorial(2 * k + 3)
        j0_coefficient = 0.25 / math.factorial(2 * k + 1)
        coefficients.append((-1.0) ** k * (j1_coefficient - j0_coefficient))

    def residual(x: float) -> float:
        """Return r j_1(y)/y - j_0(y)/4 over y^2, zero at the mode, at x = omega R/v_T."""
        square = ratio_squared * x * x  # y^2
        terms = [coefficient * square**k for k, coefficient in enumerate(coefficients)]
        return first_coefficient / square + math.fsum(terms)

    # with uniform strain a ball would breathe at omega R / v_T = (15 K/G)^(1/2); the exact root
    # is a little lower
    uniform_frequency = math.sqrt(10.0 * (1.0 + sigma) / (1.0 - 2.0 * sigma))
    lower_bound = 0.5 * uniform_frequency
    # the factor is above 1 because near sigma = -1 the root equals ``uniform_frequency`` to
    # rounding
    upper_bound = min(1.1 * uniform_frequency, _TORSIONAL_FREQUENCY)
    if residual(lower_bound) * residual(upper_bound) > 0.0:
        return None
    return float(brentq(residual, lower_bound, upper_bound, xtol=1e-16 * uniform_frequency))
