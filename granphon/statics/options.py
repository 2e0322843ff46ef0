"""The numbers of statics, each with its reason: those of the search for rest, of responses and
courses from rest, and of loading with friction, in a table each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any


def _by_axes(line: float, plane: float, space: float) -> Mapping[int, Any]:
    """Return a field of a dataclass whose default is a read-only mapping from the number of axes
    along which balls move, 1, 2 or 3, to the number ``line``, ``plane`` or ``space``.
    """
    numbers = MappingProxyType({1: line, 2: plane, 3: space})
    field_of_numbers: Mapping[int, Any] = field(default_factory=lambda: numbers)
    return field_of_numbers


@dataclass(frozen=True)
class GridOptions:
    """Options of iterations on a grid (:mod:`granphon.statics.grid_iteration`,
    :mod:`granphon.statics.lattice_equations`).

    Attributes
    ----------
    holding : stiffness, over the mean, that preconditioners add to each motion: motions that cost
        nothing, such as that of the whole, have no inverse, blocks of single balls that nothing
        holds have none in single precision, and factors could be unstable by rounding.
    damped : part of the way to its balance that each ball moves before and after Green's function:
        the energy of a contact is at most twice that of its two balls moving one at a time, so that
        with less than the whole way the preconditioner is positive definite.
    digits : decimals of the mean directions and arms of a kind of contact, and one more than those
        of the logarithms of its mean stiffnesses over the mean of all: Green's function need not be
        exact, and samples of a packing, and loads, share one. To find it takes as long as five
        iterations, of which errors of some hundredths cost none.
    kept : balls, at most, whose Green's function of mean stiffnesses is kept, and whose right sides
        share transforms: for more balls memory counts.
    kept_even : balls, at most, whose Green's function of equal contacts is kept: the function
        serves all samples and loads, and takes some 2 MB for 10^5 balls of a plane.
    waves : number of waves at which matrices are inverted at a time: those of all waves of a large
        array would take much memory.
    well_held : deformations that contacts resist over motions of balls, from which conjugate
        gradients take less time than factors, in a plane and in space, with slips and without.
        Balls are rigid from about one (Maxwell's count), near which iterations are many.
    """

    holding: float = 1e-5
    damped: float = 0.8
    digits: int = 2
    kept: int = 2**13
    kept_even: int = 2**17
    waves: int = 2**15
    well_held: float = 1.3


@dataclass(frozen=True)
class InteriorOptions:
    """Options of the interior-point method (:mod:`granphon.statics.interior`).

    Attributes
    ----------
    close : mean of f s, over the mean force to the power 5/3, at which the method ends: Newton's
        method goes on from there.
    balanced : largest force left on a ball, over the mean force, with which the method then ends
        well.
    speed : mu of a step is the mean of f s, times the factor by which that mean fell in the step
        before, to this power: mu falls the faster the faster the mean follows.
    least_factor, largest_factor : factors by which mu is lowered in a step.
    too_far : mu is not lowered while the largest force left on a ball, over the mean force, is more
        than this many times the root of mu over the mean force to the power 5/3.
    kept : least part of its value that a step leaves of an f or s.
    least_product, largest_product : product f s of a contact after a step, over mu, at least and at
        most: the smaller of f^(2/3) and s is changed where the product is not.
    accuracy : tolerance of linear equations, as a part of the factor by which mu is lowered.
    least_error, largest_error : bounds of the tolerance of linear equations, over their right side;
        the tolerance is the least where mu is held.
    width_nearby : f^(2/3) and s of a contact with h = 0, over the standard deviation of h, where
        the start is at rest under another load; on the sites of the lattice they are as large.
    """

    close: float = 1e-9
    balanced: float = 0.1
    speed: float = 1.5
    least_factor: float = 1e-2
    largest_factor: float = 0.2
    too_far: float = 10.0
    kept: float = 0.01
    least_product: float = 0.1
    largest_product: float = 100.0
    accuracy: float = 0.5
    least_error: float = 0.03
    largest_error: float = 0.1
    width_nearby: float = 0.03


@dataclass(frozen=True)
class RestOptions:
    """Options of :func:`~granphon.statics.find_rest.find_rest`.

    A residual is the largest force left, over the mean force of the contacts. Numbers of balls and
    of iterations are those on a line, in the plane and in space.

    Attributes
    ----------
    tolerance : residual at which balls are at rest: the rounding of a sum of forces.
    iterated_tolerance : residual at rest where equations are solved by iteration.
    grid_tolerance : residual at rest on a grid in the directions of the lattice, where residuals
        are over the mean force or the standard deviation of forces if that is less: at high loads
        the effect of disorder is itself only a small part of the force.
    required : residual with which a search that comes no nearer may end; with more, it has failed.
    of_all : whether ``tolerance`` and ``required``, where contacts turn, are over the mean force of
        all contacts, those that are open at the start of the search included, and not of closed
        contacts alone: the mean force of an array is that of all contacts.
    steps : steps of Newton's method, at most: 160 bring 12^3 balls to rest at f* = 1e-4.
    slopes : slopes in a line search, at most.
    slope : slope of the energy along a step, over that at its start, at which a line search ends.
    near : residual below which a step ends where the slope is no more than at its start: smaller
        slopes are rounding.
    added : stiffness that is added to all contacts, over their mean, at a residual of 1: open
        contacts have none.
    hold : stiffness of the springs that hold what nothing else holds, over the mean of contacts.
    reduction : relative residual at which iterations end near rest; and part of the error of a
        response to random forces that is left when the curvature has been probed, less than the
        part of one ball among 10^6.
    rough : relative residual at which iterations end far from rest, over the root of the residual
        of rest: a step from there need not be exact.
    untorn : part of the step at which the first contact that adheres would be torn, to which a step
        goes at most.
    shortest : length of a step that is tried even where a contact is about to be torn.
    most_factorised : balls, at most, whose matrices are factorised: factors then take about 1 GB.
    fewest_iterated : balls from which iterations are tried before factors in the directions of the
        lattice. Where most contacts are closed, 20 to 50 iterations do: of 8^3 balls of fcc they
        take 2 ms, factors 40 ms.
    patience_of_iterations : iterations with the blocks of single balls, after which factors are
        found: of 64^2 balls 50 take as long.
    patience_of_factors : iterations with the factors of an earlier step, after which new ones are
        found: a solution takes a tenth of the time of factors, and near rest 2 iterations are
        enough.
    most_iterations : iterations in a step, at most, where matrices are not factorised: the search
        goes on from what they have found.
    patience_of_grid : iterations with Green's function of an array, after which factors are found;
        and, in loading with friction, at most.
    inexact : relative error of a step of an array, at most: with more of it soft motions are hardly
        solved for, and come to rest over many steps more.
    margin : part of the tolerance that an accurate step is to leave: the largest force left falls
        less than the error of motions.
    last : residual of an array from which the tangent of a step may be that at rest.
    unchanged : change of the stiffness of each contact, over it, up to which the curvature is
        probed with the tangent of the last step.
    longest : length of a step away from a saddle, in steps of Newton's method with the other sign,
        at most.
    too_far : force left on a ball after a step, over the mean, from which an array does not take
        the step. Loose balls that the step pushes into others are left with up to some forty.
    carried : force of a contact, over the largest force left on a ball, up to which the contact
        counts as open: its stiffness would hold a ball.
    patience : steps in exact directions without half of the residual, after which loose balls and
        all others are no longer moved in turn, and the steps of an array too are those along
        which the energy falls; where balls do not differ, as many end the search.
    stalled : steps without half of the residual that end the search of balls that differ, or that
        keep the directions of the lattice in a list.
    fallen : fall of the energy in a step, over the sum of forces times overlaps, up to which it is
        rounding: as long as it falls by more, a search of balls that differ does not end so.
    detours : loads, over the given one, ascending, under which balls come to rest first where a
        search in exact directions ends without rest: other contacts are then open on the way.
    light : force of a contact, over the mean, up to which it is light: balls with no more heavy
        contacts than dimensions are loose. The same part of what is left on others may be left on
        loose balls.
    failed : force left on a ball after a step, over the most before it, from which the ball counts
        as loose too.
    worst : force left on a ball, over the largest after the step, from which the ball may count as
        loose: a step that throws a few balls shakes many others, and all of them would make
        clusters as large as the array.
    most_shaken : part of the balls, at most, that become loose by a step: one that shakes more was
        too long, and they are not loose.
    inner_steps : steps, at most, of Newton's method for loose balls while the others are held,
        which go on after the others have moved, and of the interior-point method.
    loose_slopes : slopes in a line search of a step of loose balls, at most.
    loose_slope : slope of the energy of a group of loose balls along a step, over that at its
        start, at which its line search ends: loose balls are many, and each need not be exact.
    hold_loose : stiffness of the springs that hold loose balls which nothing else holds, over the
        mean of contacts: far less than light forces resist with.
    finer : force that may be left on loose balls, over the tolerance, so that they do not keep the
        others from rest.
    rounding : force that may be left on loose balls, over the mean force, at least.
    descent : displacement with which the way down from a saddle begins, over the largest difference
        of radii.
    curvature : curvature of the energy below zero, over what forces could make, that is rounding.
    soft : stiffness of a motion, over that of a contact, up to which it costs no energy.
    workers : threads that share each Fourier transform on a grid in the directions of the lattice.
    cached : contacts of a grid that are worked on at a time, so that they stay in the processor's
        cache.
    loosest : relative residual of the linear equations of a step on such a grid, at most.
    progress : exponent: the relative residual of the equations of a step is the ratio by which the
        step before reduced the residual of rest, to this power, up to ``loosest``. Where balls that
        nothing holds come to rest, progress is slow, however accurate the steps (S. C. Eisenstat
        and H. F. Walker, SIAM J. Sci. Comput. 17, 16 (1996), choose tolerances in this way).
    spoilt : length of a step below which later ones are solved in double precision.
    even : standard deviation of stiffnesses, over their mean, up to which Green's function alone
        preconditions.
    least_difference : least scale of forces, over those that the spread of overlaps on the sites
        makes: in a chain all contacts carry the same force, but for rounding.
    move_rounding : force left on a ball of a line that the rounding of displacements explains, over
        this rounding times the mean stiffness.
    closed_on_sites : part of contacts closed on the sites, below which interior points come before
        Newton's method where the strain is given.
    interior_forces : least and largest mean force, in the unit of
        :class:`~granphon.statics.grid_problem.GridProblem`, for which interior points come before
        Newton's method where a load is given. Below, the search begins at rest under the last of
        the ``detours`` times the load.
    start_tolerance : ``grid_tolerance`` of a rest that is only the start of another search: that
        under more load, and that of an array in the directions of the lattice before a search in
        exact directions.
    differing : mean overlap, or mean force where the load is no strain, in the unit of a grid,
        below which rest in exact directions depends on its start: the side to which loose balls go,
        and so the energy, depends on where the lattice leaves them. From a start to
        ``start_tolerance`` the energy is higher, in two of three arrays in which it differs.
    interior : numbers of the interior-point method.
    threshold : mean force, in the unit of a grid, below which contacts that do not all touch carry
        nothing.
    stiff : stiffness, over the mean, from which contacts enter factors; softer ones enter by their
        part of the diagonal only.
    most_stiff : part of contacts that are stiff, above which Green's function is kept.
    patience_of_green : iterations with Green's function that cost as much as factors, measured in
        planes of 64 x 64 to 128 x 128 balls.
    cost_of_solution : cost of an iteration with factors, in iterations with Green's function.
    stale : iterations beyond those of the first equations with the same factors, from which these
        are made anew.
    most_ratio_of_stiffnesses, most_ratio_of_forces : factors by which stiffnesses of contacts, and
        forces of a load on balls, may differ where balls do not come to rest; beyond, rounding is
        named as the cause.
    most_explained : contacts, at most, for which a linear programme is to tell whether they bear a
        load.
    grid : numbers of iterations on a grid.
    """

    tolerance: float = 2e-15
    iterated_tolerance: float = 3e-13
    grid_tolerance: float = 1e-11
    required: float = 1e-12
    of_all: bool = False
    steps: int = 1000
    slopes: int = 30
    slope: float = 0.1
    near: float = 1e-6
    added: float = 1e-2
    hold: float = 1e-11
    reduction: float = 1e-4
    rough: float = 0.1
    untorn: float = 0.9
    shortest: float = 1e-9
    most_factorised: Mapping[int, int] = _by_axes(2**21, 2**18, 2**12)
    fewest_iterated: Mapping[int, int] = _by_axes(2**62, 500, 100)
    patience_of_iterations: Mapping[int, int] = _by_axes(0, 50, 150)
    patience_of_factors: int = 8
    most_iterations: int = 4000
    patience_of_grid: int = 200
    inexact: float = 1e-2
    margin: float = 0.1
    last: float = 1e-5
    unchanged: float = 1e-3
    longest: float = 2.0**10
    too_far: float = 1e2
    carried: float = 10.0
    patience: int = 20
    stalled: int = 80
    fallen: float = 1e-13
    detours: tuple[float, ...] = (2.0, 10.0)
    light: float = 1e-3
    failed: float = 0.3
    worst: float = 1e-2
    most_shaken: float = 0.25
    inner_steps: int = 100
    loose_slopes: int = 12
    loose_slope: float = 0.3
    hold_loose: float = 1e-14
    finer: float = 1e-2
    rounding: float = 5e-13
    descent: float = 1e-2
    curvature: float = 1e-6
    soft: float = 1e-9
    workers: int = 1
    cached: int = 2**14
    loosest: float = 0.15
    progress: float = 1.2
    spoilt: float = 0.3
    even: float = 0.1
    least_difference: float = 1e-4
    move_rounding: float = 16.0
    closed_on_sites: float = 0.45
    interior_forces: tuple[float, float] = (1e-4, 1.5e-2)
    start_tolerance: float = 1e-3
    differing: float = 0.05
    interior: InteriorOptions = InteriorOptions()
    threshold: float = 1e-8
    stiff: float = 1e-3
    most_stiff: Mapping[int, float] = _by_axes(0.65, 0.65, 0.42)
    patience_of_green: int = 150
    cost_of_solution: int = 3
    stale: int = 30
    most_ratio_of_stiffnesses: float = 1e10
    most_ratio_of_forces: float = 1e6
    most_explained: int = 20_000
    grid: GridOptions = GridOptions()

    def loosen(self) -> RestOptions:
        """Return the options of a search for a state that is only the start of another search, with
        ``start_tolerance`` as tolerance on a grid.
        """
        return replace(self, grid_tolerance=self.start_tolerance)


@dataclass(frozen=True)
class ResponseOptions:
    """Options of the linear response (:mod:`granphon.statics.response`).

    Attributes
    ----------
    springs : stiffnesses of the springs to the ground over the mean one of contacts, where factors
        allow them, each where the matrix is singular with those before: far above rounding, so that
        motions that cost nothing do not count as unstable, and far below what holds a ball that is
        pushed aside, W/d of the others.
    borne : part of the energy of the response that springs may bear, of which the error of an
        elastic tensor is about the square.
    borne_of_motions : part of the energy that springs may bear where motions are asked for.
    rounds : rounds of refinement, at most.
    stalled : part of the forces that a round of refinement has left, from which it comes no nearer.
    left : part of the forces that may stay where rounds come no nearer: balls that are not quite at
        rest left up to 2e-9 along motions that cost nothing.
    reduction : error of an iteration in the norm of the energy; that of an elastic tensor is at
        most its square: twelve digits are to be right. Each digit takes a twentieth of the
        iterations.
    reduction_of_motions : error of an iteration where motions are asked for.
    patience : iterations after which a grid that is small enough is factorised.
    most_iterations : iterations, at most, of a grid that is too large for factors.
    most_balls : balls on a line, in a plane, in space, at most, whose matrix is factorised: the
        memory of factors grows faster than it, to about 1 GB.
    residual : relative residual of equations that are not symmetric.
    below_aim : part of the residual that the last round by conjugate gradients aims at. Conjugate
        gradients lower the error in the norm of the energy, which falls a little otherwise than the
        residual.
    residual_of_round : relative residual after a round by GMRES.
    noise : rounding of a unit strain's forces, over the mean stiffness.
    kept, cycles : vectors that GMRES keeps, and cycles of it, at most.
    grid : numbers of iterations on a grid.
    """

    springs: tuple[float, ...] = (1e-10, 1e-8, 1e-6)
    borne: float = 1e-7
    borne_of_motions: float = 1e-11
    rounds: int = 20
    stalled: float = 0.5
    left: float = 1e-6
    reduction: float = 3e-7
    reduction_of_motions: float = 1e-9
    patience: int = 60
    most_iterations: int = 60_000
    most_balls: Mapping[int, int] = _by_axes(2**20, 2**16, 2**12)
    residual: float = 1e-10
    below_aim: float = 0.2
    residual_of_round: float = 1e-8
    noise: float = 1e-14
    kept: int = 60
    cycles: int = 40
    grid: GridOptions = GridOptions()


@dataclass(frozen=True)
class CourseOptions:
    """Options of how a rest follows parameters (:mod:`granphon.statics.rest_courses`).

    Attributes
    ----------
    step : relative step of a parameter: the error of differences is about its fourth power, and
        rounding over it.
    least_step : relative step of a parameter, at least: below, rounding is larger than what
        contacts near their opening contribute.
    part : change of the overlap of a contact in a step, over the overlap, at most.
    required : part of the derivative of the forces that rounds of refinement may end with where
        they come no nearer.
    """

    step: float = 2e-4
    least_step: float = 1e-7
    part: float = 0.02
    required: float = 1e-8


@dataclass(frozen=True)
class LoadingOptions:
    """Options of loading with friction (:mod:`granphon.array.history`,
    :mod:`granphon.array.stepper`, :mod:`granphon.array.load_step`).

    Attributes
    ----------
    tolerance : largest force, or torque over the diameter, left on a ball in balance, over the mean
        normal force. Below this part of the force before a step balls have come apart, and the
        torques of a friction coefficient below it need no balance.
    steps : steps of Newton's method, at most.
    patience : steps of Newton's method in which the residual has to fall by half, a third of them
        where limits of sliding have just been found anew; and iterations of GMRES after which balls
        are looked for that nothing but few others holds.
    forcing : part that an inner problem may leave: equations of a step of the forces on balls, less
        near balance; limits of sliding at given overlaps its square of the residual, or the square
        of that; a stage of soft contacts of the friction coefficient; balls outside a patch of the
        square of the residual.
    most_in_patch : contacts between the balls of a patch, at most: factors of more cost more than
        the iterations that they save.
    secant : share of their secant stiffness that sliding contacts of a plane have in a step of
        Newton's method, over the distance from balance in units of the friction coefficient. In
        space the share is the distance: without it nothing would hold balls whose contacts all
        slide.
    farthest : motion of a ball in a step of Newton's method, half of its rotation included, over
        the rms overlap, at most.
    loose : stiffness of a ball against turning, over that without sliding, below which it is turned
        by itself; and the torques on such balls, over all that is left of balance, from which they
        are.
    small_friction : friction coefficient below which Newton's method is continued in the shear
        stiffness of contacts, from soft ones on.
    stiffer : factor between two stages of this continuation; by which stiffness that is added to
        contacts is raised after a step that had to be made short, where a ball has lost what held
        it; by which dashpots resist more than contacts push balls aside; and, over the
        ``tolerance``, the change of the mean force that may come from the forces left on balls.
    halvings : halvings of a step of the load from which limits of sliding are found anew in each
        half, and from which errors of lost energies no longer halve it; twice as many are the most;
        and lengths of a step of Newton's method that are tried, each half of the one before.
    tries : steps of the load without a balance, steps with dashpots, and limits of sliding that are
        found anew, at most.
    often : limits of sliding that are found anew between trials of the law itself where balls are
        squeezed out from between others, on a long way.
    most_steps : steps to one load, at most.
    similar : length of a step of the load, over the one before, up to which a polynomial through
        the states is continued. The change of the mean force that is allowed to a part of a step
        is not less than that of the whole over its square: where a ball falls, one of the halves
        has all of the change.
    caution : factor of the estimate of what halving a step changes.
    of_loss, of_work : error of the energy lost in a step, over that energy and over the work of the
        load, in tolerances of the mean force.
    drag : first stiffness of dashpots over a step, in c W^(1/2): a convention, of which the mean
        force of small arrays that come from the gas keeps percents.
    weaker : factor by which dashpots are weakened from one step to the next.
    calm : steps in a row in which forces of dashpots fall, after which a balance without is tried.
    still : force of dashpots, over the mean force, at which they are taken away; in the true
        geometry of space, where they stay strong, the motion in a step, in W.
    step : change of the overlap, in W, in a step from the gas.
    standing : mean force at which an array that has been a gas has to stand, about that at
        a* = 1/2.
    most_overlap : overlap, in W, at which an array that does not stand yet is given up.
    """

    tolerance: float = 1e-9
    steps: int = 120
    patience: int = 15
    forcing: float = 0.1
    most_in_patch: Mapping[int, int] = _by_axes(2**16, 12_288, 768)
    secant: float = 0.3
    farthest: float = 0.2
    loose: float = 1e-2
    small_friction: float = 0.02
    stiffer: float = 10.0
    halvings: int = 6
    tries: int = 80
    often: int = 8
    most_steps: int = 500
    similar: float = 4.0
    caution: float = 2.0
    of_loss: float = 100.0
    of_work: float = 0.1
    drag: float = 1e-2
    weaker: float = 0.3
    calm: int = 3
    still: float = 1e-3
    step: float = 0.0125
    standing: float = 2e-2
    most_overlap: float = 2.0
