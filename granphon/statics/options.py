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
    spring : stiffness, over the mean, that preconditioners add to each motion: motions that cost
        nothing, such as that of the whole, have no inverse, blocks of single balls that nothing
        holds have none in single precision, and factors could be unstable by rounding.
    damping : part of the way to its balance that each ball moves before and after Green's function:
        the energy of a contact is at most twice that of its two balls moving one at a time, so that
        with less than the whole way the preconditioner is positive definite.
    green_step : step to which mean directions and arms of a kind of contact are rounded, and the
        logarithms of its mean stiffnesses: samples and loads share Green's functions. To find one
        takes as long as five iterations with it, of which differences of some hundredths cost none.
    small_array : balls of an array, at most, whose memory does not count: right sides are solved
        for together.
    green_memory : bytes of a Green's function, at most, that is kept for further samples and loads:
        of 10^5 balls of a plane that do not turn it takes 2 MB. Eight are kept.
    batch : contacts, or waves, that are worked on at a time, so that numbers stay in the
        processor's cache and take little memory.
    margin : part of what an accurate solution may leave that iterations aim at: the largest force
        left, and the residual, fall otherwise than the error of motions in the norm of the energy,
        which conjugate gradients lower.
    patience : iterations with Green's function after which a grid that is small enough for factors
        is factorised.
    rigidity : deformations that contacts resist over motions of balls, from which conjugate
        gradients take less time than factors, in a plane and in space, with slips and without.
        Balls are rigid from about one (Maxwell's count), near which iterations are many.
    """

    spring: float = 1e-5
    damping: float = 0.8
    green_step: float = 0.05
    small_array: int = 2**13
    green_memory: int = 2**21
    batch: int = 2**14
    margin: float = 0.1
    patience: int = 60
    rigidity: float = 1.3


@dataclass(frozen=True)
class InteriorOptions:
    """Options of the interior-point method (:mod:`granphon.statics.interior`).

    Attributes
    ----------
    gap : mean of f s, over the mean force to the power 5/3, at which the method ends: Newton's
        method goes on from there.
    imbalance : largest force left on a ball, over the mean force, with which the method then ends
        well.
    speed : mu of a step is the mean of f s, times the factor by which that mean fell in the step
        before, to this power: mu falls the faster the faster the mean follows.
    least_factor, largest_factor : factors by which mu is lowered in a step.
    lag : mu is not lowered while the largest force left on a ball, over the mean force, is more
        than this many times the root of mu over the mean force to the power 5/3.
    least_part : least part of its value that a step leaves of an f or s.
    least_product, largest_product : product f s of a contact after a step, over mu, at least and at
        most: the smaller of f^(2/3) and s is changed where the product is not.
    accuracy : tolerance of linear equations, as a part of the factor by which mu is lowered.
    least_error : tolerance of linear equations, over their right side, at least, and where mu is
        held.
    nearby_width : f^(2/3) and s of a contact with h = 0, over the standard deviation of h, where
        the start is at rest under another load; where it is on the sites of the lattice, they are
        as large as that deviation.
    """

    gap: float = 1e-9
    imbalance: float = 0.1
    speed: float = 1.5
    least_factor: float = 1e-2
    largest_factor: float = 0.2
    lag: float = 10.0
    least_part: float = 0.01
    least_product: float = 0.1
    largest_product: float = 100.0
    accuracy: float = 0.5
    least_error: float = 0.03
    nearby_width: float = 0.03


@dataclass(frozen=True)
class RestOptions:
    """Options of :func:`~granphon.statics.find_rest.find_rest`.

    A residual is the largest force left, over the mean force of the contacts. A mapping has the
    numbers on a line (1), in the plane (2) and in space (3).

    Attributes
    ----------
    tolerance : residual at which balls are at rest: the rounding of a sum of forces.
    iterated_tolerance : residual at rest where equations are solved by iteration.
    grid_tolerance : residual at rest on a grid in the directions of the lattice, where residuals
        are over the mean force or the standard deviation of forces if that is less: at high loads
        the effect of disorder is itself only a small part of the force.
    negligible_force : force, over the mean force, that counts as none: with a larger one left a
        search that comes no nearer has failed.
    of_all : whether ``tolerance`` and ``negligible_force``, where contacts turn, are over the mean
        force of all contacts, those that are open at the start of the search included, and not of
        closed contacts alone: the mean force of an array is that of all contacts.
    steps : steps of Newton's method, at most: 160 bring 12^3 balls to rest at f* = 1e-4.
    slopes : slopes in a line search, at most.
    slope : slope of the energy along a step, over that at its start, at which a line search ends.
    rounding_residual : residual below which a step ends where the slope is no more than at its
        start: smaller slopes are rounding.
    added_stiffness : stiffness that is added to all contacts, over their mean, at a residual of 1:
        open contacts have none.
    spring : stiffness of the springs that hold what nothing else holds, over the mean of contacts.
    reduction : relative residual at which iterations end near rest.
    probe_reduction : part of the error of a response to random forces that is left when the
        curvature has been probed, less than the part of one ball among 10^6.
    rough_reduction : relative residual at which iterations end far from rest, over the root of the
        residual of rest: a step from there need not be exact.
    tear_part : part of the step at which the first contact that adheres would be torn, to which a
        step goes at most.
    most_balls : balls, at most, whose matrices are factorised: factors then take about 1 GB.
    fewest_balls : balls from which iterations are tried before factors in the directions of the
        lattice. Where most contacts are closed, 20 to 50 iterations do: of 8^3 balls of fcc they
        take 2 ms, factors 40 ms. On a line there are never so many: iterations would
        be about as many as balls, and a band is factorised at once.
    patience_of_iterations : iterations with the blocks of single balls, after which factors are
        found: of 64^2 balls 50 take as long. On a line, where factors come first, there are
        none.
    patience_of_factors : iterations with the factors of an earlier step, after which new ones are
        found: a solution takes a tenth of the time of factors, and near rest 2 iterations are
        enough.
    most_iterations : iterations in a step, at most, where matrices are not factorised: the search
        goes on from what they have found.
    largest_error : relative error of a step of an array, at most, be the step found by iterations
        or by the factors of an earlier step: with more of it soft motions are hardly solved for,
        and come to rest over many steps more.
    near_residual : residual below which an array is near rest: the tangent of a step may be that at
        rest, and loose balls and all others move in turn again.
    stiffness_change : change of the stiffness of each contact, over it, up to which the curvature
        is probed with the tangent of the last step.
    longest_step : length of a step away from a saddle, in steps of Newton's method with the other
        sign, at most.
    farthest_residual : force left on a ball after a step, over the mean, from which an array does
        not take the step. Loose balls that the step pushes into others are left with up to some
        forty.
    open_force : force of a contact, over the largest force left on a ball, up to which the contact
        counts as open: its stiffness would hold a ball.
    patience_of_turns : steps in exact directions without half of the residual, after which loose
        balls and all others are no longer moved in turn, but all along steps down the energy.
    patience : steps without half of the residual that end a search of a list; in exact directions
        not as long as the energy of balls that differ falls.
    detours : loads, over the given one, ascending, under which balls come to rest first where a
        search in exact directions ends without rest: other contacts are then open on the way.
    light_force : force of a contact, over the mean, up to which it is light: balls with no more
        heavy contacts than dimensions are loose.
    loosening_force : force left on a ball after a step, over the most before it, from which the
        ball counts as loose too.
    shaken_force : force left on a ball, over the largest after the step, from which the ball may
        count as loose: a step that throws a few balls shakes many others, and all of them would
        make clusters as large as the array.
    shaken_part : part of the balls, at most, that become loose by a step: one that shakes more was
        too long, and they are not loose.
    inner_steps : steps, at most, of a method that only leads to where Newton's method for all balls
        begins: of loose balls while the others are held, or of the interior-point method.
    loose_slopes : slopes in a line search of a step of loose balls, at most.
    loose_slope : slope of the energy of a group of loose balls along a step, over that at its
        start, at which its line search ends: loose balls are many, and each need not be exact.
    loose_spring : stiffness of the springs that hold loose balls which nothing else holds, over the
        mean of contacts: far less than light forces resist with.
    loose_force : force that may be left on loose balls, over what is left on the others or, near
        rest, may be left on them, so that loose balls do not keep the others from rest.
    loose_rounding : force that may be left on loose balls, over the mean force, at least.
    descent : displacement with which the way down from a saddle begins, over the largest difference
        of radii.
    curvature : curvature of the energy below zero, over what forces could make, that is rounding.
    soft_stiffness : stiffness of a motion, over that of a contact, up to which it costs no energy.
    workers : threads that share each Fourier transform on a grid in the directions of the lattice.
    largest_reduction : relative residual of the linear equations of a step on such a grid, at most.
    progress : exponent: the relative residual of the equations of a step is the ratio by which the
        step before reduced the residual of rest, to this power, up to ``largest_reduction``. Where
        balls that nothing holds come to rest, progress is slow, however accurate the steps (S. C.
        Eisenstat and H. F. Walker, SIAM J. Sci. Comput. 17, 16 (1996), choose tolerances in this
        way).
    single_length : length of a step below which later ones are solved in double precision.
    stiffness_spread : standard deviation of stiffnesses, over their mean, up to which Green's
        function alone preconditions.
    least_difference : least scale of forces, over those that the spread of overlaps on the sites
        makes: in a chain all contacts carry the same force, but for rounding.
    move_rounding : force left on a ball of a line that the rounding of displacements explains, over
        this rounding times the mean stiffness.
    closed_part : part of contacts closed on the sites, below which interior points come before
        Newton's method where the strain is given.
    least_interior_force, largest_interior_force : mean forces, in the unit of
        :class:`~granphon.statics.grid_problem.GridProblem`, for which interior points come before
        Newton's method where a load is given. Below, the search begins at rest under the last of
        the ``detours`` times the load.
    start_tolerance : ``grid_tolerance`` of a rest that is only the start of another search: that
        under more load, and that of an array in the directions of the lattice before a search in
        exact directions.
    uncertain_load : mean overlap, or mean force where the load is no strain, in the unit of a grid,
        below which rest in exact directions depends on its start: the side to which loose balls go,
        and so the energy, depends on where the lattice leaves them. From a start to
        ``start_tolerance`` the energy is higher, in two of three arrays in which it differs.
    interior : numbers of the interior-point method.
    threshold : mean force, in the unit of a grid, below which contacts that do not all touch carry
        nothing.
    factor_stiffness : stiffness, over the mean, from which contacts enter factors; softer ones
        enter by their part of the diagonal only.
    stiff_part : part of contacts that are stiff, above which Green's function is kept.
    patience_of_green : iterations with Green's function that cost as much as factors, measured in
        planes of 64 x 64 to 128 x 128 balls.
    cost_of_solution : cost of an iteration with factors, in iterations with Green's function.
    staleness : iterations beyond those of the first equations with the same factors, from which
        these are made anew.
    most_ratio_of_stiffnesses, most_ratio_of_forces : factors by which stiffnesses of contacts, and
        forces of a load on balls, may differ where balls do not come to rest; beyond, rounding is
        named as the cause.
    most_contacts : contacts, at most, for which a linear programme is to tell whether they bear a
        load.
    grid : numbers of iterations on a grid.
    """

    tolerance: float = 2e-15
    iterated_tolerance: float = 3e-13
    grid_tolerance: float = 1e-11
    negligible_force: float = 1e-12
    of_all: bool = False
    steps: int = 1000
    slopes: int = 30
    slope: float = 0.1
    rounding_residual: float = 1e-6
    added_stiffness: float = 1e-2
    spring: float = 1e-11
    reduction: float = 1e-4
    probe_reduction: float = 1e-4
    rough_reduction: float = 0.1
    tear_part: float = 0.9
    most_balls: Mapping[int, int] = _by_axes(2**21, 2**18, 2**12)
    fewest_balls: Mapping[int, int] = _by_axes(2**62, 500, 100)
    patience_of_iterations: Mapping[int, int] = _by_axes(0, 50, 150)
    patience_of_factors: int = 8
    most_iterations: int = 4000
    largest_error: float = 1e-2
    near_residual: float = 1e-5
    stiffness_change: float = 1e-3
    longest_step: float = 2.0**10
    farthest_residual: float = 1e2
    open_force: float = 10.0
    patience_of_turns: int = 20
    patience: int = 80
    detours: tuple[float, ...] = (2.0, 10.0)
    light_force: float = 1e-3
    loosening_force: float = 0.3
    shaken_force: float = 1e-2
    shaken_part: float = 0.25
    inner_steps: int = 100
    loose_slopes: int = 12
    loose_slope: float = 0.3
    loose_spring: float = 1e-14
    loose_force: float = 1e-3
    loose_rounding: float = 5e-13
    descent: float = 1e-2
    curvature: float = 1e-6
    soft_stiffness: float = 1e-9
    workers: int = 1
    largest_reduction: float = 0.15
    progress: float = 1.2
    single_length: float = 0.3
    stiffness_spread: float = 0.1
    least_difference: float = 1e-4
    move_rounding: float = 16.0
    closed_part: float = 0.45
    least_interior_force: float = 1e-4
    largest_interior_force: float = 1.5e-2
    start_tolerance: float = 1e-3
    uncertain_load: float = 0.05
    interior: InteriorOptions = InteriorOptions()
    threshold: float = 1e-8
    factor_stiffness: float = 1e-3
    stiff_part: Mapping[int, float] = _by_axes(0.65, 0.65, 0.42)
    patience_of_green: int = 150
    cost_of_solution: int = 3
    staleness: int = 30
    most_ratio_of_stiffnesses: float = 1e10
    most_ratio_of_forces: float = 1e6
    most_contacts: int = 20_000
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
    spring_energy : part of the energy of the response that springs may bear, of which the error of
        an elastic tensor is about the square.
    spring_energy_of_motions : part of the energy that springs may bear where motions are asked for.
    rounds : rounds of refinement, at most.
    stalled_part : part of the forces that a round of refinement has left, from which it comes no
        nearer.
    remainder : part of the forces that may stay where rounds come no nearer: balls that are not
        quite at rest left up to 2e-9 along motions that cost nothing.
    reduction : error of an iteration in the norm of the energy; that of an elastic tensor is at
        most its square: twelve digits are to be right. Each digit takes a twentieth of the
        iterations.
    reduction_of_motions : error of an iteration where motions are asked for.
    most_iterations : iterations, at most, of a grid that is too large for factors.
    most_balls : balls on a line, in a plane, in space, at most, whose matrix is factorised: the
        memory of factors grows faster than it, to about 1 GB.
    residual : relative residual of equations that are not symmetric.
    residual_of_round : relative residual after a round by GMRES.
    noise : rounding of a unit strain's forces, over the mean stiffness.
    vectors, cycles : vectors that GMRES keeps, and cycles of it, at most.
    grid : numbers of iterations on a grid.
    """

    springs: tuple[float, ...] = (1e-10, 1e-8, 1e-6)
    spring_energy: float = 1e-7
    spring_energy_of_motions: float = 1e-11
    rounds: int = 20
    stalled_part: float = 0.5
    remainder: float = 1e-6
    reduction: float = 3e-7
    reduction_of_motions: float = 1e-9
    most_iterations: int = 60_000
    most_balls: Mapping[int, int] = _by_axes(2**20, 2**16, 2**12)
    residual: float = 1e-10
    residual_of_round: float = 1e-8
    noise: float = 1e-14
    vectors: int = 60
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
    overlap_change : change of the overlap of a contact in a step, over the overlap, at most.
    remainder : part of the derivative of the forces that rounds of refinement may end with where
        they come no nearer.
    """

    step: float = 2e-4
    least_step: float = 1e-7
    overlap_change: float = 0.02
    remainder: float = 1e-8


@dataclass(frozen=True)
class LoadingOptions:
    """Options of loading with friction (:mod:`granphon.array.history`,
    :mod:`granphon.array.stepper`, :mod:`granphon.array.load_step`).

    Attributes
    ----------
    tolerance : largest force, or torque over the diameter, left on a ball in balance, over the mean
        normal force: smaller forces count as none, and friction of a smaller coefficient too.
        Forces of contacts then have an error of about as much.
    steps : steps of Newton's method, at most.
    patience : steps of Newton's method in which the residual has to fall by half, a third of them
        where limits of sliding have just been found anew.
    forcing : part of the right side that the linear equations of a step of Newton's method may
        leave: near balance this part times the root of the residual. A step costs as much as some
        five iterations.
    most_iterations : iterations of GMRES in a step of Newton's method, at most.
    patience_of_balls : iterations of GMRES after which balls are looked for that nothing but few
        others holds.
    most_in_patch : contacts between the balls of a patch, at most: factors of more cost more than
        the iterations that they save.
    limit_part : part of the residual that is left where limits of sliding are fixed, before the
        limits are found anew; on a long way, of balls that are squeezed out, its square.
    limit_rounds : limits of sliding that are found anew between trials of the law itself where
        balls are squeezed out from between others, on a long way.
    secant_share : share of their secant stiffness that sliding contacts of a plane have in a step
        of Newton's method, over the distance from balance in units of the friction coefficient. In
        space the share is the distance: without it nothing would hold balls whose contacts all
        slide.
    farthest : motion of a ball in a step of Newton's method, half of its rotation included, over
        the rms overlap, at most.
    lengths : lengths of a step of Newton's method that are tried, each half of the one before.
    loose_stiffness : stiffness of a ball against turning, over that without sliding, below which
        the ball is turned by itself.
    small_friction : friction coefficient below which Newton's method is continued in the shear
        stiffness of contacts, from soft ones on.
    stiffening : factor between two stages of a continuation in a stiffness: in the shear stiffness
        with small friction, and in the stiffness that is added to contacts while steps have to be
        made short.
    halvings : halvings of a step of the load, at most. From half of them on all means are used,
        whatever they cost, and errors need not fall with the step.
    tries : attempts at a balance, at most: by shorter steps of the load, by dashpots, or with
        limits of sliding that are found anew.
    most_steps : steps to one load, at most.
    similar : length of a step of the load, over the one before, up to which a polynomial through
        the states is continued.
    loss_error, work_error : error of the energy lost in a step, over that energy and over the work
        of the load, in tolerances of the mean force.
    drag : first stiffness of dashpots over a step, in c W^(1/2): a convention, on which the mean
        force of small arrays that come from the gas depends by some percents.
    weakening : factor by which dashpots are weakened from one step to the next.
    calm_steps : steps in a row in which forces of dashpots do not grow, after which a balance
        without dashpots is tried.
    still_force : force of dashpots, over the mean force, at which they are taken away.
    still_motion : motion in a step, in W, at which dashpots are taken away that stay as strong as
        the pushes of contacts, in the true geometry of space.
    step : change of the overlap, in W, in a step from the gas.
    standing_force : mean force at which an array that has been a gas has to stand, about that at a*
        = 1/2.
    most_overlap : overlap, in W, at which an array that does not stand yet is given up.
    """

    tolerance: float = 1e-10
    steps: int = 120
    patience: int = 15
    forcing: float = 0.3
    most_iterations: int = 200
    patience_of_balls: int = 15
    most_in_patch: Mapping[int, int] = _by_axes(2**16, 12_288, 768)
    limit_part: float = 1e-2
    limit_rounds: int = 8
    secant_share: float = 0.3
    farthest: float = 0.2
    lengths: int = 6
    loose_stiffness: float = 1e-2
    small_friction: float = 0.02
    stiffening: float = 10.0
    halvings: int = 12
    tries: int = 80
    most_steps: int = 500
    similar: float = 4.0
    loss_error: float = 100.0
    work_error: float = 0.1
    drag: float = 1e-2
    weakening: float = 0.3
    calm_steps: int = 3
    still_force: float = 1e-3
    still_motion: float = 1e-3
    step: float = 0.0125
    standing_force: float = 2e-2
    most_overlap: float = 2.0
