"""The numbers of the search for rest, each with its reason, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


def _largest_factors() -> Mapping[int, int]:
    return MappingProxyType({1: 2**21, 2: 2**18, 3: 2**12})


def _fewest_iterated() -> Mapping[int, int]:
    return MappingProxyType({1: 2**62, 2: 500, 3: 100})


def _patience() -> Mapping[int, int]:
    return MappingProxyType({1: 0, 2: 50, 3: 150})


@dataclass(frozen=True)
class RestOptions:
    """Options of :func:`~granphon.statics.rest.find_rest`.

    Residuals are the largest force left, over the mean force of the contacts.

    Attributes
    ----------
    tolerance : residual at which balls are at rest: the rounding of a sum of forces.
    iterated_tolerance : the same where equations are solved by iteration.
    required : residual that must be reached.
    steps : steps of Newton's method, at most.
    slopes : slopes in a line search, at most.
    endless : length of a step, in its own, from which on the energy is taken to fall without end.
    slope : slope of the energy along a step, over that at its start, at which a line search ends.
    added : stiffness that is added to all contacts, over their mean, at a residual of 1: open
        contacts have none.
    relaxed : mean force, over that before the balls have moved, at which nothing is left of it.
    hold : stiffness of the springs that hold what nothing else holds, over the mean of contacts.
    hold_alone : the same of single balls in a preconditioner, where rounding grows by its inverse.
    most_factorised : balls on a line, in the plane, in space, at most, whose matrices are
        factorised: factors then take about 1 GB.
    fewest_iterated : balls on a line, in the plane, in space, from which iterations are tried
        before factors in the directions of the lattice. Where most contacts are closed, 20 to 50
        iterations do: of 8^3 balls of fcc they take 2 ms, factors 40 ms.
    patience_of_iterations : iterations with the blocks of single balls, by the number of axes,
        after which factors are taken instead: of 64^2 balls 50 take as long.
    patience_of_factors : iterations with the factors of an earlier step, after which new ones are
        found: a solution takes a tenth of the time of factors.
    most_band : diagonals beside the main one, at most, of a matrix that is taken as a band.
    rounded_force : what rounding leaves of the forces on a ball, over their size.
    carried : force, over the residual, up to which a contact carries nothing, as its stiffness
        would hold a ball.
    most_iterations : iterations in one step where factors take too much, at most.
    patience : steps without half of the residual, after which loose balls and all others are no
        longer moved in turn; four times as many end the search.
    light : force of a contact, over the mean, up to which it is light: balls with no more heavy
        contacts than dimensions are loose.
    loose_tolerance : force that may be left on a loose ball, over the mean, in units of the spread
        of diameters or of what is left on others.
    failed : force left on a ball after a step, over the most before it, from which the ball counts
        as loose too.
    farthest : residual after a whole step of Newton's method, from which the step is not taken.
    loose_slope : as ``slope``, where contacts turn.
    loose_steps : steps of loose balls while the others are held, at most.
    loose_slopes : trials of the lengths of such a step, at most.
    saddles : saddles of the energy on the way, at most.
    descent : displacement with which the way down from a saddle begins, over the largest difference
        of radii.
    doublings : doublings of this displacement, at most.
    curvature : curvature of the energy below zero, over what forces could make, that is rounding.
    soft : stiffness of a motion, over that of a contact, up to which it costs no energy.
    """

    tolerance: float = 2e-15
    iterated_tolerance: float = 3e-13
    required: float = 1e-12
    steps: int = 200
    slopes: int = 60
    endless: float = 1e7
    slope: float = 0.1
    added: float = 1e-2
    relaxed: float = 1e-12
    hold: float = 1e-11
    hold_alone: float = 1e-6
    most_factorised: Mapping[int, int] = field(default_factory=_largest_factors)
    most_band: int = 2
    fewest_iterated: Mapping[int, int] = field(default_factory=_fewest_iterated)
    patience_of_iterations: Mapping[int, int] = field(default_factory=_patience)
    patience_of_factors: int = 8
    most_iterations: int = 4000
    rounded_force: float = 4e-16
    carried: float = 10.0
    patience: int = 20
    light: float = 1e-3
    loose_tolerance: float = 1e-3
    failed: float = 0.3
    farthest: float = 1e2
    loose_slope: float = 0.3
    loose_steps: int = 100
    loose_slopes: int = 12
    saddles: int = 50
    descent: float = 1e-2
    doublings: int = 6
    curvature: float = 1e-6
    soft: float = 1e-9
