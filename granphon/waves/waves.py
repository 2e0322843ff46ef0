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
from granphon.base.progress import Progress, silent
from granphon.base.text import counted
from granphon.base.validation import finite_array, frequency_array, is_one_of, whole_number
from granphon.dynamics.damping import DampedModes, Losses
from granphon.media.cost import Cost
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.validity import network_warnings
from granphon.waves.branches import find_branches
from granphon.waves.chebyshev import Kernel
from granphon.waves.dos import (
    MOST_MOMENTS,
    AllModes,
    LocalDensity,
    RandomVectors,
    SpectralDensity,
    find_local_density,
)
from granphon.waves.modes import (
    DENSE,
    NetworkModes,
    count_modes,
    find_damped,
    find_modes,
    find_whole,
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
    progress : is told how far densities, spectral functions, modes, responses and pulses have come:
        ``granphon.base.progress.Terminal()`` draws a bar on stderr. :meth:`estimate` says before
        how long they take.

    Raises :class:`~granphon.base.errors.InputError` for something else, and for balls that are not
    at rest under the static forces that act
    (:meth:`~granphon.networks.network.ContactNetwork.require_rest`).
    """

    def __init__(self, source: Any, *, progress: Progress = silent) -> None:
        self.network: ContactNetwork = given_network(source)
        self.network.require_rest()
        self._progress = progress

    def __repr__(self) -> str:
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

        Every result has these warnings too.
        """
        return network_warnings(self.network)

    @cached_property
    def operator(self) -> WaveOperator:
        """D of the network as a linear operator, (rad/s)^2."""
        return make_operator(self.network, self._progress)

    @cached_property
    def _stable_operator(self) -> WaveOperator:
        """D of the network; an :class:`~granphon.base.errors.InstabilityError` if a squared
        frequency is below zero.
        """
        require_stable(self.operator)
        return self.operator

    def estimate(self, name: str, *arguments: Any, **options: Any) -> Cost:
        """Return what a result costs on one processor of this machine, before it does.

        Parameters
        ----------
        name : the method that finds it: "dos", "spectral_function", "modes", "branches",
            "count_modes", "response" or "transmit"; or "moduli", of :func:`gp.moduli
            <granphon.moduli>` and of sound; or "transmission", of :func:`granphon.transmission`
            through this network.
        arguments, options : those of the method; none of moduli; of a transmission the two leads,
            the frequencies, ``axis`` and ``q``.

        :attr:`~granphon.media.cost.Cost.text` says it in words; ``memory`` is in bytes, and
        ``seconds`` is the processor's time, within a factor of about three: D is made, and one
        product with it is timed. For modes that are filtered out of random vectors the density of
        states is found, a small part of the search.

        Raises :class:`~granphon.base.errors.InputError` for another name, and what the method
        refuses by its numbers.
        """
        from granphon.waves.estimates import WaveEstimate

        return WaveEstimate(self.operator).find(name, *arguments, **options)

    def dos(
        self,
        resolution: float | None = None,
        vectors: int = 10,
        seed: int = 0,
        *,
        moments: int | None = None,
    ) -> SpectralDensity:
        """Return the density of states, 1/Hz per ball that moves, by the kernel polynomial method.

        Up to 600 motions of all balls all modes are found, and the density has no error. Of larger
        networks it is estimated by random vectors.

        Parameters
        ----------
        resolution : standard deviation of the kernel at frequency zero, Hz; above it is finer.
        vectors : number of random vectors; the error falls as its root, and as that of the number
            of balls.
        seed : from which the random vectors are drawn.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        Raises :class:`~granphon.base.errors.InputError` for numbers out of range, and for more than
        2^26 moments of all random vectors; :class:`~granphon.base.errors.InstabilityError` if a
        squared frequency is below zero. With one vector the error is nan. Memory is that of D, of
        about six vectors, of those kept for more moments, up to 256 MiB, and of the densities of
        all random vectors: about 400 bytes for each moment of each vector while they are found.
        """
        operator = self._stable_operator
        vectors = whole_number("vectors", vectors, 1, MOST_MOMENTS)
        seed = whole_number("seed", seed, 0)
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        if operator.size <= DENSE:
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

        It is found from moments of the motions themselves, without random vectors, and has no error
        but that of the kernel.

        Parameters
        ----------
        ball : its index.
        frequencies : (n_f,) Hz.
        resolution : standard deviation of the kernel at frequency zero, Hz; above it is finer.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        Raises :class:`~granphon.base.errors.InputError` for a ball that is not there or does not
        move, and for numbers out of range; :class:`~granphon.base.errors.InstabilityError` if a
        squared frequency is below zero.
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
        """Return A(q, f), the spectrum of plane waves, by the kernel polynomial method: the
        positions of balls give phases.

        Parameters
        ----------
        q : (d,) or (n, d) wave vectors, Cartesian, 1/m. Along periods of the cell they must be
            those that it has;
            :meth:`nearest_wavevectors` finds these.
        polarisation : "longitudinal", along q; "transverse", across q; "rotational"; or numbers,
            one for each displacement, or one for each motion of a ball. Where several directions
            are across q, or several axes of rotation are free, the result is the mean over them; in
            the plane, waves across q move in the plane if balls can.
        resolution : standard deviation of the kernel at frequency zero, Hz; above it is finer.
        direction : (2,) or (3,): of a transverse wave, its part across q; of a rotational one, the
            axis; of a wave with q = 0, which has none of its own, that of the displacements.
        moments : number of Chebyshev moments, in place of the resolution; 256 without either.

        Raises :class:`~granphon.base.errors.InputError` for a q that the cell does not have, whose
        message names the nearest one, and for a polarisation in which balls do not move;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        operator = self._stable_operator
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        return PlaneWaves(operator, q, polarisation, direction).find(kernel.moments)

    def modes(self, count: int = 10, nearest: float | None = None) -> NetworkModes:
        """Return the lowest modes, or those nearest to a frequency, without those that cost no
        energy, which are counted.

        Parameters
        ----------
        count : number of modes.
        nearest : frequency, Hz; None for the lowest modes.

        Up to 600 motions that contacts resist, and where more than a third of the modes are
        requested, all modes are found (dense). Larger networks are factorised, and counted by the
        signs of the pivots so that no mode is missed, up to 300,000 motions in the plane and
        120,000 in space. Beyond, the lowest modes are found by a block of vectors, which are
        followed down with a preconditioner of two levels: the work grows as the number of motions.
        Modes ``nearest`` to a frequency, and the lowest ones where more than 48 modes cost no
        energy, are filtered out of random vectors by Chebyshev polynomials: that work grows as the
        square of the number of motions, and is the same for one mode as for tens of them. In both
        ways fresh random vectors, freed of the modes that were found, show whether one is missed.

        Raises :class:`~granphon.base.errors.InputError` for a frequency above the top, more modes
        than there are, or, before any filter is applied, for modes that take more than 4 GiB or two
        million products of D with a vector; :class:`~granphon.base.errors.InstabilityError` if a
        squared frequency is below zero; :class:`~granphon.base.errors.ConvergenceError` if they
        turn out to take more, as where hundreds of modes have one frequency, or where a gap around
        ``nearest`` is wide.
        """
        return find_modes(self._stable_operator, count, nearest)

    def whole_modes(self, count: int = 10, nearest: float | None = None) -> DampedModes:
        """Return the lowest modes, or those nearest to a frequency, of all that acts at contacts:
        also of static tangential forces, and of slip by the radii, without a potential.

        :meth:`modes` are those of the symmetric part of the matrix. The rest changes frequencies in
        second order of T/(k r) and of the overlap, and where two are next to each other it may make
        them a pair of complex ones, of which one grows and the other decays, as in the program from
        which the law is. Without such forces the modes are those of :meth:`modes`.

        Parameters
        ----------
        count, nearest : number of modes, and the frequency, Hz, to which their real parts are
            nearest; None for the lowest.

        Frequencies are complex, Hz; those of modes that grow have an imaginary part below zero. Up
        to 600 motions all modes are found (dense); larger networks, up to 300,000 motions in the
        plane and 12,000 in space, are factorised, and nothing proves that no mode is missed.

        Raises :class:`~granphon.base.errors.InputError` for more motions, for more modes than cost
        energy, and for more than a third of all in a large network; and
        :class:`~granphon.base.errors.InstabilityError` as :meth:`modes`.
        """
        return find_whole(self._stable_operator, count, nearest)

    def branches(self, q: ArrayLike, count: int = 6) -> Array:
        """Return the lowest branches of a network that repeats, (n_q, count) Hz, ascending, at
        given wave vectors.

        Only the lowest ones are found, so that the network may have 1e5 balls;
        :meth:`gp.Phonons.frequencies <granphon.Phonons.frequencies>` has all branches of cells of a
        few thousand balls. Frequencies up to 1e-6 of the top one are zero, and are among them.

        Parameters
        ----------
        q : (n_q, p) or (p,) wave vectors, in fractions of the reciprocal vectors of the p periods,
            in their order.
        count : number of branches at each wave vector.

        Raises :class:`~granphon.base.errors.InputError` for a network without a period, wave
        vectors of another shape, and more branches than a third of all, or so;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero;
        :class:`~granphon.base.errors.ConvergenceError` if the branches are not found, as where
        hundreds of them are zero.
        """
        return find_branches(self.operator, q, count)

    def count_modes(self, frequencies: ArrayLike) -> Any:
        """Return the number of modes below each frequency, with those that cost no energy.

        The number is proven: D - omega^2 is factorised, and has as many eigenvalues below zero as
        pivots (Sylvester's law of inertia). Differences are the numbers of modes between two
        frequencies, and the average of the density of states there.

        Parameters
        ----------
        frequencies : (n_f,) or a number, Hz, above zero. At or below 1e-6 of the top frequency the
            modes that cost no energy are counted.

        Returns whole numbers (n_f,), or one. Each takes a factor: of 1e4 balls in space, with
        rotations, 10 s of a processor at 2 to 3 GHz, and 1 GB; the time grows as the square of the
        number of balls in space, and as its power 3/2 in the plane. Raises
        :class:`~granphon.base.errors.InputError` for frequencies that are not above zero, and for
        more motions than are factorised, 300,000 in the plane and 120,000 in space;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        hertz = finite_array("frequencies", frequencies, "Hz", "above zero")
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
        polarisation: str | ArrayLike = "longitudinal",
        distance: float | None = None,
        method: str | None = None,
        tolerance: float = TOLERANCE,
    ) -> Response:
        """Return complex amplitudes of balls, or of forces of contacts, while balls or a wall are
        driven at given frequencies.

        Motions are u exp(i omega t). The network is left as it is, finite, periodic or cut.
        Frequencies of small networks are solved one by one, those of large ones by a Krylov space
        for all of them where that is less work; :attr:`Response.method` says which, and
        :attr:`Response.error` how well.

        Parameters
        ----------
        frequencies : (n_f,) Hz, ascending.
        source : (ball, direction), where ball is an index or several, and direction "x", "y", "z"
            or a vector (1,) to (3,); "plane", the first plane of balls; or a list of these, which
            are driven together. A force of 1 N pushes each ball. With
            ``quantity="transmissibility"`` or "stiffness" the source is a body that does not move
            by itself, such as a wall, a floor or a clamped ball, and is moved; "plane" is then the
            first of these, and "floor" the one flat wall, which is moved towards the balls.
        receiver : likewise, one for each ball; "plane" is the last plane of balls, or that at the
            ``distance``. A force is that of the contact (i, j) of two balls, of the "floor", or of
            (ball, direction): a sensor in the ball, which reads half of the sum of the normal
            forces of its contacts, each times the cosine of its normal and the direction, so the
            mean of two contacts of a chain; in a body that is held, the whole sum.
        damping : s, the viscosity c of each contact over its stiffness k, as in :meth:`transmit`: a
            number or (n_c,), or a tuple of that in normal motion and in all other.
        loss_factor : eta of the complex stiffness k (1 + i eta), a number or (n_c,), or a tuple of
            two, as the damping.
        drag : 1/s, of the force -drag m v and the torque -drag I omega on each ball: a number, or a
            tuple of that of displacements and of rotations.
        dashpot : c, N s/m, of each contact: a number or (n_c,), or a tuple of that in normal motion
            and in slip. Twist and rolling are damped with the time c/k of slip.
        restitution : e, above zero and up to 1, a number or (n_c,): a dashpot c = alpha(e) (m*
            k)^1/2 in normal motion and in slip, with which a collision has this e at any velocity
            (:mod:`granphon.dynamics.damping`).
        quantity : "displacement", of the balls over the force, m/N; "velocity", m/(N s);
            "acceleration", 1/kg; "force", normal force of contacts over that of the source, above
            zero where these are pressed more, springs and dashpots taken together;
            "transmissibility", the displacement of the balls over that of the source; or
            "stiffness", the force over the displacement of the source, N/m, which "force" is too
            where the source is held.
        direction : (1,) to (3,) across the planes; by default the first axis along which the
            network does not repeat, or x.
        polarisation : of "plane", along which it is driven and heard, as in :meth:`transmit`.
        distance : m, of the receiving plane from the first.
        method : "direct", factors at each frequency; "krylov", a space for all of them; None for
            the faster.
        tolerance : bound of the error, over the largest response at a frequency, with which a
            Krylov space is content.

        Raises
        ------
        InputError : frequencies below zero, not real or not sorted; a ball that is not there or,
            but where a wall is moved, one of the source that is held; no receiver; a sensor without
            a contact; a loss below zero, a restitution of zero or above 1; a mode without losses at
            a frequency.
        ConvergenceError : a network too large to be factorised, and damped too little, or unevenly;
            or what would take more than an hour, unless a ``method`` is given.
        InstabilityError : a squared frequency is below zero.
        """
        operator = self._stable_operator
        hertz = frequency_array("frequencies", frequencies)
        options = ResponseOptions.read(quantity, method, tolerance)
        losses = Losses.of(self.network, damping, loss_factor, drag, dashpot, restitution)
        places = Places(self.network, direction, polarisation, distance)
        return find_response(operator, hertz, source, receiver, options, losses, places)

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
        """Return damped modes that cost energy, the lowest or those nearest to a frequency: complex
        frequencies, Q factors.

        Parameters
        ----------
        count, nearest : number of modes, and the frequency, Hz, to which their real parts are
            nearest; None for the lowest.
        damping, loss_factor, drag, dashpot, restitution : as for :meth:`response`.

        Modes that creep have a real part of zero: they are the lowest, and the slowest of them is
        the first.

        Where all motions are damped alike, the modes are those of :meth:`modes`: they are chosen by
        their frequencies without losses, then damped.
        Where motions are damped unevenly, and contacts resist up to 300 of them (up to 600 if many
        modes are requested), all modes are computed, and chosen by their real parts.
        Larger networks, up to 300,000 such motions in the plane and 120,000 in space, are
        factorised, and modes are chosen among those nearest in the complex plane. Modes that creep
        fast are far away there, though their real part is zero, and may then be missing.

        Raises :class:`~granphon.base.errors.InputError` for a damping below zero, for more modes
        than there are, or than are found in a large network, and for more
        unevenly damped motions than are factorised;
        :class:`~granphon.base.errors.PrecisionError` for dashpots that differ and are far stiffer
        than springs; :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end;
        and what :meth:`modes` raises.
        """
        losses = Losses.of(self.network, damping, loss_factor, drag, dashpot, restitution)
        return find_damped(self._stable_operator, count, nearest, losses)

    def nearest_wavevectors(self, q: ArrayLike) -> Array:
        """Return the wave vectors nearest to ``q`` (d,) or (n, d), 1/m, that the periodic cell has,
        in the same shape.

        Along an axis without a period the cell has every wave vector.
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
        """Send a pulse through the network, and hear it on a plane of balls.

        A force sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2, 1 N at its greatest, pushes each ball of
        the source from t = 0 to P = cycles/frequency. The dynamics are linear, and propagated to
        rounding: by an expansion in Chebyshev polynomials whose coefficients that are left out add
        up to 1e-13.

        Parameters
        ----------
        frequency : Hz, up to the top of the network's modes.
        direction : (1,) to (3,) the direction in which the pulse travels, Cartesian.
        distance : m, of the receiving plane: that of the balls nearest to it, which the result
            says. It counts from the source; if that is a plane at an end, from the end: the plane
            halfway between the first balls and those that were before them, or the balls of the
            wall.
        cycles : periods of the burst, 1 or more.
        polarisation : "longitudinal"; "transverse", which in the plane of balls is across the
            direction, and in space along the axis farthest from it; "out_of_plane"; or a vector
            (1,) to (3,) along which the source pushes. Signals are velocities along it.
        source : "plane": the first plane of balls; "ball": one of them; or the index of a ball, or
            several.
        ends : "free": contacts across the plane before the first balls are cut, and balls that
            static forces then push over are left out (``left_out`` of the result); "walls": the
            balls before it are held; "periodic": the network stays as it is, and the pulse runs
            both ways. A network without a period along the direction, such as one between walls of
            its own, is left as it is.
        damping : s, the viscosity of each contact over its stiffness, as in :meth:`response`: a
            mode of the angular frequency omega decays as exp(-damping omega^2 t/2).
        tangential_damping : s, the same of slip, twist and rolling, if it is another than that of
            normal motion.
        drag, dashpot, restitution : as in :meth:`response`. Where contacts or motions are damped
            differently, as with static forces, modes exchange energy, and the propagation takes
            several times as long.
        duration : s, of the record. By default that of the burst and three times that of a wave in
            which balls move in proportion, which is the fastest; in a periodic network it ends
            before that wave comes round the other way, and must hold the burst and its flight. With
            another duration the signals are right too, but may not be of one pulse.
        planes : (n_p,) distances of further planes on which the mean velocity is recorded, m.
        frames : (n_f,) times at which the velocities of all balls are kept, s.

        Raises
        ------
        InputError : planes across the direction meet themselves in the periodic network before
            twice the distance (with ends, before the distance); there are no balls there, or they
            are those of the source, or no contacts join them with it; nothing resists the
            polarisation; a number out of range; a record that takes more than 2^20 products with D,
            or that the other way round a periodic network ends before the burst and its flight are
            over.
        UnreachableFrequencyError : the frequency is above all modes of the network.
        InstabilityError : the prestress makes a squared frequency negative, or leaves no array
            between free ends.

        Where the pulse has no time of flight, it is nan, and the warnings of the result say why.
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
        # ends that are cut or held make another network, with an operator of its own
        operator = self._stable_operator if is_one_of(ends, ("periodic",)) else None
        pulse = transmit(self.network, request, operator, self._progress)
        return replace(pulse, warnings=(*self.warnings, *pulse.warnings))
