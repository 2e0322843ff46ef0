"""Waves in a finite network of contacts: the entry to densities of states, spectral functions,
modes and pulses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.progress import Progress, silent
from granphon.base.text import counted
from granphon.base.validation import finite_array, frequency_array
from granphon.dynamics.damping import DampedModes, GivenLosses, Losses
from granphon.media.cost import Cost
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.validity import network_warnings
from granphon.waves.branches import find_branches
from granphon.waves.chebyshev import Kernel
from granphon.waves.dos import (
    AllModes,
    DensityRequest,
    LocalDensity,
    RandomVectors,
    SpectralDensity,
    find_local_density,
)
from granphon.waves.modes import (
    MOST_DENSE_MOTIONS,
    NetworkModes,
    count_modes,
    find_damped,
    find_modes,
    find_whole_modes,
    read_request,
    require_countable,
    require_stable,
)
from granphon.waves.operator import WaveOperator, make_operator
from granphon.waves.pulses import Pulse, PulseSource, transmit
from granphon.waves.response import (
    TOLERANCE,
    Places,
    Response,
    ResponseOptions,
    find_response,
)
from granphon.waves.spectral_functions import PlaneWaves, SpectralFunction, nearest_wavevectors


class Waves:
    """The waves of a network of contacts.

    Parameters
    ----------
    source : a :class:`~granphon.networks.network.ContactNetwork`; a simulated sample; a state,
        whose network is one cell, so that these are waves at Gamma; or ``ase.Atoms`` with a
        :class:`~granphon.phonons.calculator.HertzMindlin`.
    progress : is told how far the work for a result has come, where the work takes many steps:
        ``granphon.base.progress.Terminal()`` draws a bar on stderr. :meth:`estimate` says
        beforehand how long a result takes.

    Raises :class:`~granphon.base.errors.InputError` for any other source, and for balls that are
    not at rest under the static forces that act
    (:meth:`~granphon.networks.network.ContactNetwork.require_rest`). All methods but
    :meth:`nearest_wavevectors` raise it for a network without waves: no ball moves, there is no
    contact, or the motions of balls deform none.
    """

    def __init__(self, source: Any, *, progress: Progress = silent) -> None:
        self.network: ContactNetwork = given_network(source)
        self.network.require_rest()
        self._progress = progress

    def __repr__(self) -> str:
        """Return the numbers of balls and contacts, and the motions of each ball."""
        network = self.network
        motions = self.network.ball_motions
        return (
            f"Waves({counted(network.n_balls, 'ball')}, {counted(network.n_contacts, 'contact')},"
            f" {', '.join(motions.letters)} of each ball; frequencies in Hz)"
        )

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of the contact law that the network exceeds, in the words of
        :func:`gp.validity`; and one if static forces act and leave more than 1e-3 of their mean on
        a ball.

        Densities and spectral functions of all balls, :meth:`modes`, :meth:`whole_modes` and pulses
        have these warnings too.
        """
        return network_warnings(self.network)

    @cached_property
    def operator(self) -> WaveOperator:
        """The dynamical matrix D = M^-1/2 S M^-1/2 of the network, (rad/s)^2, as a linear operator:
        ``operator @ x`` is D x. S is the symmetric stiffness matrix, with the static forces that
        act, and M holds the masses and moments of inertia.

        A vector x (size,) holds the mass-weighted motions of all balls that move. The operator's
        method ``vector`` makes such a vector of values (n_free, motions), and ``values`` does the
        reverse; both may share memory with what they are given.
        The eigenvalues of D are squared angular frequencies. The operator is made once, when it is
        used first. Raises :class:`~granphon.base.errors.InputError` if no ball moves or there is no
        contact; and when the operator is applied, if the motions of balls deform no contact.
        """
        return make_operator(self.network, self._progress)

    @cached_property
    def _stable_operator(self) -> WaveOperator:
        """D of the network. When D is first asked for, the network is checked to be stable.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero,
        and what :attr:`operator` and :func:`~granphon.waves.modes.is_stable` raise.
        """
        require_stable(self.operator)
        return self.operator

    def _require_stable(self) -> None:
        """Raise what :attr:`_stable_operator` raises, for a result that has D already."""
        _ = self._stable_operator

    def estimate(self, name: str, *arguments: Any, **options: Any) -> Cost:
        """Return an estimate of the time and memory that a result takes on one processor of this
        machine.

        Parameters
        ----------
        name : the method that finds it: "dos", "spectral_function", "modes", "branches",
            "count_modes", "response" or "transmit"; or "moduli", of :func:`gp.moduli
            <granphon.moduli>` and of sound; or "transmission", of :func:`granphon.transmission`
            through this network.
        arguments, options : those of the method. The source and the receiver of a response do not
            change its cost, and may be left out. Moduli have none. A transmission has the two
            leads, the frequencies, ``axis``, ``q`` and the losses.

        :attr:`~granphon.media.cost.Cost.text` of the estimate is a sentence; ``memory`` is in
        bytes, and ``seconds`` is the processor's time, within a factor of about three. For the
        estimate D is made, and if the result takes products with D, one product is timed. For modes
        that are filtered out of random vectors the density of states is computed too, a small part
        of the search.

        Raises :class:`~granphon.base.errors.InputError` for another name, for arguments that the
        method does not have or that are missing, and for values that the method refuses. But the
        source and the receiver of a response are not looked at, nor what these require of its
        polarisation, direction and distance; the frequency of a pulse is only compared with a bound
        of all modes; and whether memory suffices is examined for modes and the frames of a pulse
        alone. Raises :class:`~granphon.base.errors.ConvergenceError` for a response that takes too
        much, as :meth:`response` does, and :class:`~granphon.base.errors.InstabilityError` for an
        array that does not hold between the free ends of a pulse, and if the density of states that
        is computed for modes meets a squared frequency below zero. Else it is not examined whether
        the network is stable.
        """
        from granphon.waves.estimates import WaveEstimate

        estimate = WaveEstimate(self.operator)
        try:
            find_cost = estimate.bind(name, *arguments, **options)
        except TypeError as error:
            problem = f"these are not the arguments of {name}: {error}"
            raise InputError(problem, mend="Give what the result itself takes") from None
        return find_cost()

    def dos(
        self,
        resolution: float | None = None,
        vectors: int = 10,
        seed: int = 0,
        *,
        moments: int | None = None,
    ) -> SpectralDensity:
        """Return the density of states, 1/Hz per ball that moves, by the kernel polynomial method.

        If all balls together have up to 600 motions, all modes are found, and the density has no
        error. The density of a larger network is estimated by random vectors.

        Parameters
        ----------
        resolution : standard deviation of the kernel at frequency zero, Hz; at higher frequencies
            the kernel is narrower.
        vectors : number of random vectors, for a network of more than 600 motions; the error falls
            as the root of this number, and as the root of the number of balls. With one vector the
            error is nan.
        seed : whole number from which the random vectors are drawn, zero or above.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        The memory for a larger network is that of D, of about six vectors, of vectors that are kept
        for more moments, up to 256 MiB, and of the densities of all random vectors, about 400 bytes
        for each moment of each vector.

        Raises :class:`~granphon.base.errors.InputError` for numbers out of range, for a resolution
        together with moments, and for more than 2^26 moments of all random vectors;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        kernel, vectors, seed = DensityRequest.read(
            self.operator, resolution, vectors, seed, moments
        )
        operator = self._stable_operator
        if operator.size <= MOST_DENSE_MOTIONS:
            return AllModes(operator, seed).find(kernel.moments, vectors)
        return RandomVectors(operator, seed, vectors).find(kernel.moments, vectors)

    def local_dos(
        self,
        ball: int,
        frequencies: ArrayLike,
        resolution: float | None = None,
        *,
        moments: int | None = None,
    ) -> LocalDensity:
        """Return the local density of states of a ball at given frequencies, 1/Hz, for each of its
        motions.

        The density is found from the moments of the vectors in which the ball alone moves, without
        random vectors. It is exact, but for the kernel, which broadens each line.

        Parameters
        ----------
        ball : index of the ball.
        frequencies : (n_f,) or a number, which stands for (1,), Hz.
        resolution : standard deviation of the kernel at frequency zero, Hz; at higher frequencies
            the kernel is narrower.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        Raises :class:`~granphon.base.errors.InputError` for a ball that is not there or does not
        move, for numbers out of range, for a resolution together with moments, and for more
        frequencies than memory holds;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        return find_local_density(self._stable_operator, ball, frequencies, resolution, moments)

    def spectral_function(
        self,
        q: ArrayLike,
        polarisation: str | ArrayLike = "longitudinal",
        resolution: float | None = None,
        *,
        direction: ArrayLike | None = None,
        moments: int | None = None,
    ) -> SpectralFunction:
        """Return the spectral function A(q, f), the spectrum of plane waves with the wave vectors
        q, by the kernel polynomial method.

        Parameters
        ----------
        q : (d,) or (n, d) wave vectors, Cartesian, 1/m; on a line also a number. Their waves must
            repeat with the periodic cell; :meth:`nearest_wavevectors` finds such wave vectors near
            any q.
        polarisation : "longitudinal": balls move along q. "transverse": balls move across q.
            "rotational": balls turn. Or numbers, one for each displacement, or one for each motion
            of a ball. If several directions are across q, or several axes of rotation are free, the
            result is the mean over them. In the plane, transverse waves move in the plane if balls
            can.
        resolution : standard deviation of the kernel at frequency zero, Hz; at higher frequencies
            the kernel is narrower.
        direction : (1,) to (3,) vector. A transverse wave moves along its part across q, and a
            rotational wave turns about its part along the axes about which balls turn. A wave of
            displacements with q = 0, which has no direction of its own, moves along it.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        Raises :class:`~granphon.base.errors.InputError` for a q that the cell does not have (the
        message names the nearest one), for a polarisation in which balls do not move, for a
        direction that is missing or has no use, for a resolution together with moments, for numbers
        out of range, for more moments and wave vectors than memory holds, and for a wave in which
        no ball with contacts moves;
        :class:`~granphon.base.errors.PrecisionError` for a q so long that its phases have no
        digits; and :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below
        zero.
        """
        kernel = Kernel.of(self.operator.top / (2.0 * math.pi), resolution, moments)
        plane_waves = PlaneWaves(self.operator, q, polarisation, direction)
        self._require_stable()
        return plane_waves.find(kernel.moments)

    def modes(self, count: int = 10, nearest: float | None = None) -> NetworkModes:
        """Return the lowest modes, or those nearest to a frequency, without those that cost no
        energy, which are counted.

        Parameters
        ----------
        count : number of modes.
        nearest : frequency, Hz; None for the lowest modes.

        The method depends on the number of motions that contacts resist:

        - Up to 600 motions all modes are found by a dense matrix. Up to 10,000 motions all modes
          are found in this way if more than a third of them are requested, or have to be searched,
          as where many cost no energy.
        - Up to 1,000,000 motions on a line, 300,000 in the plane and 120,000 in space the matrix
          is factorised, and the signs of the pivots count the modes, so that no mode is missed.
        - Of more motions the lowest modes are found by a block of vectors with a preconditioner of
          two levels; the work grows as the number of motions.
        - Of more motions the modes ``nearest`` to a frequency are filtered out of random vectors by
          Chebyshev polynomials. The lowest modes are filtered too if more than 48 modes cost no
          energy, besides those of single balls, or if the block would have more than a third as
          many vectors as there are motions. The work grows as the square of the number of motions,
          and is the same for one mode as for tens of them.

        With the last two methods, which count no pivots, fresh random vectors show whether a mode
        is missing: these vectors are iterated or filtered as the others were, and what they have of
        the modes that were found is taken out.

        Raises :class:`~granphon.base.errors.InputError` for a count that is no whole number above
        zero, for a frequency below zero or above the top, for more modes than there are or than
        memory holds, for modes of more than 10,000 motions of which more than a third would have to
        be found, and, before any filter is applied, for modes that take more than 4 GiB or two
        million products of D with a vector; :class:`~granphon.base.errors.InstabilityError` if a
        squared frequency is below zero; :class:`~granphon.base.errors.ConvergenceError` if the
        modes turn out to take more, as when hundreds of modes have one frequency, or a gap around
        ``nearest`` is wide, and if the iteration does not end.
        """
        read_request(self.operator, count, nearest)  # refuses before the long check of stability
        return find_modes(self._stable_operator, count, nearest)

    def whole_modes(self, count: int = 10, nearest: float | None = None) -> DampedModes:
        """Return the lowest modes, or those nearest to a frequency, with all forces at contacts:
        also those without a potential, which are static tangential forces and torques, and slip by
        levers that exceed the arms of contacts, as by the radii.

        :meth:`modes` returns the modes of the symmetric part of the matrix. The antisymmetric part
        changes frequencies in second order of T/(k r) and of the overlap. Two frequencies that are
        next to each other may become a pair of complex ones, so that one mode grows and the other
        decays; the motion in a program with such forces does the same. Without such forces the
        modes are those of :meth:`modes`.

        Parameters
        ----------
        count, nearest : number of modes, and the frequency, Hz, to which their real parts are
            nearest; None for the lowest.

        Frequencies are complex, Hz; those of modes that grow have an imaginary part below zero. Up
        to 600 motions all modes are found by a dense matrix. Larger networks, up to 1,000,000
        motions on a line, 300,000 in the plane and 12,000 in space, are factorised, and nothing
        proves that no mode is missing.

        Raises :class:`~granphon.base.errors.InputError` for a count that is no whole number above
        zero, for a frequency below zero or above the top, for more motions than the limit above,
        for more modes than cost energy or than memory holds, and for more than a third of all modes
        of a large network; :class:`~granphon.base.errors.InstabilityError` as :meth:`modes` does;
        and :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end.
        """
        read_request(self.operator, count, nearest)  # refuses before the long check of stability
        return find_whole_modes(self._stable_operator, count, nearest)

    def branches(self, q: ArrayLike, count: int = 6) -> Array:
        """Return the lowest branches of a network that repeats, (n_q, count) Hz, ascending, at
        given wave vectors.

        Only the lowest branches are found, so that the network may have 1e5 balls;
        :meth:`gp.Phonons.frequencies <granphon.Phonons.frequencies>` returns all branches of cells
        of a few thousand balls. Frequencies up to 1e-6 of the top frequency are returned as zero.

        Parameters
        ----------
        q : (n_q, p) or (p,) wave vectors, in fractions of the reciprocal vectors of the p periods,
            in their order; a number is one wave vector if p is 1.
        count : number of branches at each wave vector.

        Raises :class:`~granphon.base.errors.InputError` for a network without a period, for wave
        vectors of another shape or not finite, for a count that is no whole number above zero, for
        more branches than there are, and for more than about a third of them in a network of more
        than 600 motions;
        :class:`~granphon.base.errors.PrecisionError` for wave vectors too far from Gamma;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero, unless
        forces without a potential act, see :meth:`whole_modes`: it is then returned as zero;
        :class:`~granphon.base.errors.ConvergenceError` if the branches are not found, as when
        hundreds of them are zero.
        """
        return find_branches(self.operator, q, count)

    def count_modes(self, frequencies: ArrayLike) -> Any:
        """Return the number of modes below each frequency, with those that cost no energy: whole
        numbers in the shape of ``frequencies``, or an int if ``frequencies`` is a number.

        The number is proven: D - omega^2 is factorised, and has as many eigenvalues below zero as
        pivots below zero (Sylvester's law of inertia). The difference of two of these numbers is
        the number of modes between their frequencies, the integral of the density of states.

        Parameters
        ----------
        frequencies : (...) or a number, Hz, above zero. For frequencies at or below 1e-6 of the top
            frequency, only the modes that cost no energy are counted.

        Each frequency up to the top frequency takes one factorisation: of 1e4 balls in space, with
        rotations, 10 s of a processor at 2 to 3 GHz, and 1 GB; the time grows as the square of the
        number of balls in space, and as its power 3/2 in the plane.

        Raises :class:`~granphon.base.errors.InputError` for no frequency, for frequencies that are
        not above zero or not finite, and for more motions than are factorised, 1,000,000 on a line,
        300,000 in the plane and 120,000 in space;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero; and
        :class:`~granphon.base.errors.ConvergenceError` if a matrix cannot be factorised.
        """
        hertz = finite_array("frequencies", frequencies, "Hz", "above zero")
        require_countable(self.operator)  # refuses before the long check of stability
        counts = count_modes(self._stable_operator, np.ravel(hertz)).reshape(hertz.shape)
        return counts if hertz.shape else int(counts)

    def response(
        self,
        frequencies: ArrayLike,
        source: Any,
        receiver: Any,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        *,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
        quantity: str = "displacement",
        direction: ArrayLike | None = None,
        polarisation: str | ArrayLike | None = None,
        distance: float | None = None,
        method: str | None = None,
        tolerance: float = TOLERANCE,
    ) -> Response:
        """Return the complex amplitudes of balls, or of forces of contacts, in the steady motion
        that a source makes at given frequencies.

        Motions are u exp(i omega t). The network is left as it is, finite, periodic or cut. Of
        static tangential forces the part counts that has a potential, as for :meth:`modes`. The
        frequencies of small networks are solved one by one. Those of large networks are solved by
        one Krylov space if that is less work; :attr:`Response.method` says which method was taken,
        and :attr:`Response.error` how large the error is.

        Parameters
        ----------
        frequencies : (n_f,) Hz, ascending.
        source : (ball, direction), where ball is an index or several, and direction "x", "y", "z"
            or a vector (1,) to (3,); or "plane", the first plane of balls; or a list of these,
            which are driven together. A force of 1 N pushes each ball. With
            ``quantity="transmissibility"`` or "stiffness" the source is a body that is held, such
            as a wall, a floor or a clamped ball, and is displaced; "plane" is then the first plane
            of such bodies, and "floor" the one flat wall, which is displaced towards the balls.
        receiver : balls in the same form, each of which is a receiver; "plane" is the last plane of
            balls, or that at the ``distance``. For a force, a receiver is the contact (i, j) of two
            balls, the "floor", or (ball, direction), a sensor in the ball. A sensor reads half of
            the sum of the normal forces of the contacts of its ball, each times the magnitude of
            the cosine between its normal and the direction; in a chain this is the mean of two
            contacts. A sensor in a body that is held reads the whole sum.
        damping : viscosity c of each contact over its stiffness k, s, as in :meth:`transmit`: a
            number or (n_c,), or a tuple of that in normal motion and of that in all other.
        loss_factor : eta of the complex stiffness k (1 + i eta): a number or (n_c,), or a tuple of
            that in normal motion and of that in all other.
        drag : rate of the force -drag m v and of the torque -drag I omega on each ball, 1/s: a
            number, or a tuple of that of displacements and of that of rotations.
        dashpot : viscosity c of each contact, N s/m: a number or (n_c,), or a tuple of that in
            normal motion and of that in slip. Twist and rolling are damped with the time c/k of
            slip.
        restitution : e of a collision, above zero and up to 1, a number or (n_c,): each contact has
            a dashpot c = alpha(e) (m* k)^1/2 in normal motion and in slip, with which a collision
            has this e at any velocity (:mod:`granphon.dynamics.damping`).
        quantity : "displacement" of the balls over the force, m/N; "velocity", m/(N s);
            "acceleration", 1/kg; "force", the normal force of contacts, springs and dashpots
            together, over that of the source, above zero where contacts are pressed more;
            "transmissibility", the displacement of the balls over that of the source; or
            "stiffness", the force over the displacement of the source, N/m, which is also taken for
            "force" if all bodies of the source are held.
        direction : (1,) to (3,) vector across the planes; by default the first axis along which the
            network does not repeat, or x.
        polarisation : direction in which a "plane" is driven and heard, as in :meth:`transmit`; by
            default "longitudinal".
        distance : distance of the receiving plane from the first one, m; in a network that repeats
            along the direction, whole periods count as zero.
        method : "direct": factors at each frequency; "krylov": one space for all frequencies; None
            for factors in a network of up to 2000 motions, and for the faster of both at each
            frequency in a larger one.
        tolerance : bound of the error, over the largest response at a frequency, at which a Krylov
            space ends; above zero and below 1.

        Raises
        ------
        InputError : no frequency, or frequencies below zero, not real, not ascending or given
            twice; a ball or contact that is not there; a ball of the source that is held, unless a
            wall is displaced; a wall that is displaced and touches no ball that moves; a receiver
            of motion that is held; a "floor" where there is none, or several; a direction along
            which balls do not move; no source, or no receiver; a sensor without a contact, or at
            one of several contacts of two balls; a plane without a distance in a network that
            repeats along the direction; a direction, or a polarisation other than "longitudinal",
            where no plane is driven or heard; a distance where no plane is heard; a loss below
            zero, a restitution below 1e-6 or above 1; another word for the quantity or the method;
            a tolerance that is not above zero and below 1; the ``method`` "krylov" where some
            motions lose no energy and others do, or where forces without a potential, see
            :meth:`whole_modes`, act beside other losses than an even drag; more receivers and
            frequencies than memory holds; a mode without losses at one of the frequencies.
        ConvergenceError : losses that are too small or uneven for a Krylov space, in a network that
            is too large to be factorised or with the ``method`` "krylov"; the ``method`` "direct"
            in a network that is too large to be factorised; or, unless a ``method`` is given, a
            response that would take more than an hour.
        InstabilityError : a squared frequency is below zero.
        """
        hertz = frequency_array("frequencies", frequencies)
        options = ResponseOptions.read(quantity, method, tolerance)
        given_losses = GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        losses = Losses.of(self.network, given_losses)
        places = Places(self.network, direction, polarisation, distance)
        # D is made, and found to be stable, after source and receiver have been read
        return find_response(
            lambda: self._stable_operator, hertz, source, receiver, options, losses, places
        )

    def damped_modes(
        self,
        count: int = 10,
        nearest: float | None = None,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        *,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
    ) -> DampedModes:
        """Return damped modes that cost energy, the lowest or those nearest to a frequency, with
        their complex frequencies and Q factors.

        Parameters
        ----------
        count, nearest : number of modes, and the frequency, Hz, to which their real parts are
            nearest; None for the lowest.
        damping, loss_factor, drag, dashpot, restitution : losses, as for :meth:`response`.

        Modes that creep have a real part of zero: they are the lowest modes, and the slowest of
        them is the first.

        If losses are even, the modes are those of :meth:`modes`: they are chosen by their
        frequencies without losses, and then damped. Losses are even if they are the same in all
        contacts and motions, and if contacts lose no energy where static forces or springs to the
        ground act.
        If losses are not even, and contacts resist up to 300 motions (up to 600 if many modes are
        requested), all modes are computed, and chosen by their real parts. Larger networks, up to
        1,000,000 such motions on a line, 300,000 in the plane and 120,000 in space, are factorised,
        and modes are chosen among those nearest in the complex plane. Modes that creep fast are far
        away there, though their real part is zero, and may then be missing.

        Raises :class:`~granphon.base.errors.InputError` for a count that is no whole number above
        zero, for losses that :meth:`response` refuses, for a frequency below zero or above the top,
        for more modes than there are, than memory holds, or than can be found in a large network,
        and if losses are not even and there are more motions than are factorised;
        :class:`~granphon.base.errors.PrecisionError` for dashpots that differ and are far stiffer
        than springs; :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end;
        and what :meth:`modes` raises.
        """
        given_losses = GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        losses = Losses.of(self.network, given_losses)
        read_request(self.operator, count, nearest)  # refuses before the long check of stability
        return find_damped(self._stable_operator, count, nearest, losses)

    def nearest_wavevectors(self, q: ArrayLike) -> Array:
        """Return the wave vectors nearest to ``q`` (d,) or (n, d), 1/m, whose waves repeat with the
        periodic cell, in the same shape; on a line ``q`` may also be a number.

        Along an axis without a period any component is allowed. Raises
        :class:`~granphon.base.errors.InputError` for a ``q`` of another shape, empty or not finite,
        and :class:`~granphon.base.errors.PrecisionError` for a ``q`` so long that its phases have
        no digits.
        """
        return nearest_wavevectors(self.network, q)

    def transmit(
        self,
        frequency: float,
        direction: ArrayLike,
        distance: float,
        cycles: float = 5.0,
        polarisation: str | ArrayLike = "longitudinal",
        *,
        source: str | int | Sequence[int] = "plane",
        ends: str = "free",
        damping: Any = 0.0,
        tangential_damping: float | None = None,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
        duration: float | None = None,
        planes: ArrayLike = (),
        frames: ArrayLike = (),
    ) -> Pulse:
        """Send a pulse through the network, and return what is received of it on a plane of balls.

        A force sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2, in N, pushes each ball of the source
        from t = 0 to P = cycles/frequency. The dynamics are linear, and propagated to rounding, by
        an expansion in Chebyshev polynomials: the coefficients that are left out add up to 1e-13 at
        most.

        Parameters
        ----------
        frequency : frequency of the burst, Hz, up to the top of the network's modes.
        direction : (1,) to (3,) direction in which the pulse travels, Cartesian.
        distance : distance of the receiving plane, m. The plane of the balls nearest to this
            distance is taken, and the result has its distance. Distances count from the source; if
            ``source`` is "plane" and a period was cut for ``ends``, from that end, which is the
            plane halfway between the first balls and those that were before them, or the balls of
            the wall.
        cycles : number of periods of the burst, 1 or more.
        polarisation : direction in which the source pushes, and of the velocities that are
            received: "longitudinal"; "transverse", which in the plane of balls is across the
            direction, and in space along the axis farthest from it; "out_of_plane"; or a vector
            (1,) to (3,).
        source : "plane": the first plane of balls; "ball": one of these balls; or the index of a
            ball, or several.
        ends : "free": contacts across the plane before the first balls are cut, and balls that
            static forces then push over are left out (``left_out`` of the result). "walls": the
            balls before that plane are held. "periodic": the network stays as it is, and the pulse
            runs both ways. A network without a period along the direction, such as one between
            walls of its own, is left as it is; "walls" are refused there.
        damping : viscosity of each contact over its stiffness, s, as in :meth:`response`: a mode of
            the angular frequency omega decays as exp(-damping omega^2 t/2). Numbers of each contact
            are those of all contacts of the network, also of those that ``ends`` cut.
        tangential_damping : the same for slip, twist and rolling, s, if it differs from that of
            normal motion, as the second of a pair ``damping=(normal, tangential)`` is.
        drag, dashpot, restitution : further losses, as in :meth:`response`. If losses are not even,
            see :meth:`damped_modes`, modes exchange energy, and the propagation takes several times
            as long.
        duration : length of the record, s. The default is that of the burst and three times the
            flight of the fastest long wave to the farthest plane. In a periodic network the record
            ends before that wave comes round the other way, and must hold the burst and its flight.
            With another duration the signals are right too, but may not be of one pulse.
        planes : (n_p,) distances of further planes on which the mean velocity is recorded, m.
        frames : (n_f,) times at which the velocities of all balls are kept, s.

        Raises
        ------
        InputError : planes across the direction meet themselves in the periodic network before
            twice the distance (with ends, before the distance); there are no balls at the distance,
            or they are those of the source, or no contacts join them with the source; balls do not
            move along the direction of the polarisation, or nothing resists it; a ball of the
            source is not there or does not move; the direction leaves the line or plane of the
            balls; another word is given for the polarisation, the source or the ends; "walls" have
            no place; a number is out of range, or losses are so strong that nothing moves;
            ``tangential_damping`` is given beside a pair of ``damping``; the record takes more than
            2^20 products with D or 2^24 readings; frames do not fit into memory; in a periodic
            network the pulse that runs the other way round ends the record before the burst and
            its flight are over.
        UnreachableFrequencyError : the frequency is above all modes of the network.
        InstabilityError : the prestress makes a squared frequency negative, or leaves no array
            between free ends.
        ConvergenceError : the highest mode, with which the frequency is compared, is not found.

        If the time of flight is not known, it is nan, and the warnings of the result say why.
        """
        request = PulseSource(
            frequency,
            direction,
            distance,
            cycles,
            polarisation,
            source=source,
            ends=ends,
            damping=damping,
            tangential_damping=tangential_damping,
            drag=drag,
            dashpot=dashpot,
            restitution=restitution,
            duration=duration,
            planes=planes,
            frames=frames,
        )
        pulse = transmit(self.network, request, lambda: self._stable_operator, self._progress)
        return replace(pulse, warnings=(*self.warnings, *pulse.warnings))
