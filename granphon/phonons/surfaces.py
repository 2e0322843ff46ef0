"""Waves at an edge of what repeats: spectra of its outer layer, undamped and leaky waves, and the
velocity of long ones.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.ball import Wall
from granphon.balls.lattices import one_direction
from granphon.balls.layers import read_edge
from granphon.base.arrays import Array, Index
from granphon.base.errors import GranphonError, InputError, InstabilityError
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.staging import write_text
from granphon.base.standard_errors import read_errors
from granphon.base.tables import Heading, table_text
from granphon.base.text import counted
from granphon.base.validation import (
    finite_array,
    positive,
    real_array,
    require,
    truth,
    whole_number,
)
from granphon.dynamics.compatibility import require_digits
from granphon.dynamics.edge_energies import EdgeEnergies
from granphon.dynamics.half_space import HalfSpace
from granphon.dynamics.sensitivities import FrequencySensitivities
from granphon.dynamics.zak_phase import find_winding, find_zak_phase
from granphon.media.state import State
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.validity import network_warnings
from granphon.phonons.paths import default_letters, interpolate_path, special_points

#: memory of a spectrum at one q and frequency over the square of the motions of a block, bytes
_SPECTRUM_BYTES = 320.0
#: number of frequencies at which the search for waves solves for the outer layer at one q, about
_N_SEARCHED = 30
#: lowest angular frequency of a spectrum, over the highest; it stands for zero, where the spectrum
#: is a quotient of zeros
_LOWEST_FREQUENCY = 1e-7
#: number of frequencies of a map
N_FREQUENCIES = 241
#: highest frequency of a map over the highest of the bands
_TOP_OF_MAP = 1.05
#: -omega^2, over the highest of a wave vector, up to which it is the rounding of zero
_ROUNDED_SQUARE = 1e-7
#: component of a unit vector up to which it is the rounding of zero
_ROUNDING = 1e-9


@result_class
class SurfaceBranches(Result):
    """Waves of an edge at a list of wave vectors, one row for each wave; ``branches[i]`` are the
    frequencies at the i-th.

    Attributes
    ----------
    qpoints : (n_q, 3) wave vectors along the edge, fractions of the reciprocal cell of a layer.
    place : (n,) the number of the wave vector of each wave.
    frequencies : (n,) Hz, ascending at each wave vector.
    widths : (n,) full width at half maximum of its line, Hz; zero of a wave that does not leak.
    weight : (n,) part of its kinetic energy in the outer layers, as many as contacts reach across.
    """

    qpoints: Array = held(float, "q 3")
    place: Index = held(int, "n")
    frequencies: Array = held(float, "n", "Hz")
    widths: Array = held(float, "n", "Hz")
    weight: Array = held(float, "n")

    def __len__(self) -> int:
        """Return the number of wave vectors."""
        return len(self.qpoints)

    def __getitem__(self, index: int) -> Array:
        """Return the frequencies, Hz, of the waves at the wave vector of number ``index``, in one
        array, empty without waves; a number below zero counts from the last. Raises IndexError
        beyond the wave vectors, and TypeError for what is no whole number, such as a slice.
        """
        place = range(len(self))[operator.index(index)]
        return np.asarray(self.frequencies[self.place == place])


@result_class
class SurfaceSensitivities(Result):
    """Derivatives of the frequencies of waves of an edge, one row for each wave.

    A wave of an edge changes with each contact in two ways: with that contact of all layers, as in
    another crystal, and with that of one layer alone, as at an edge that is softer than the bulk.

    Attributes
    ----------
    waves : the waves, as :meth:`Surface.branches` has them.
    crystal : derivatives by the contacts and balls of :attr:`Surface.network`, each changed in all
        layers at once, down to the bulk. Contacts with a wall stay.
    outer : derivatives by the contacts and balls of :attr:`Surface.outer`, each changed in one
        layer alone, all along the edge; contacts with a wall are among them.
    """

    waves: SurfaceBranches = held(SurfaceBranches)
    crystal: FrequencySensitivities = held(FrequencySensitivities)
    outer: FrequencySensitivities = held(FrequencySensitivities)


@result_class
class SurfaceSpectrum(Result, array="values"):
    """Spectrum of the outer layer of a half space. ``np.asarray`` of it is ``values``.

    Attributes
    ----------
    qpoints : (n_q, 3) wave vectors along the edge, fractions of the reciprocal cell of a layer.
    frequencies : (n_f,) Hz.
    values : (n_q, n_f) 1/Hz: the mean over the motions and the balls of the layer; the integral
        over frequency is 1.
    by_motion : (n_q, n_f, motions) 1/Hz, of each motion, the mean over the balls; the integral of
        each is 1.
    letters : names of the motions.
    damping : full width at half maximum of the line of an undamped wave, Hz.
    edges : (n_q, b, 2) lowest and highest frequency of each branch of the crystal at each wave
        vector, Hz.
    waves : the waves of the edge at the same wave vectors; None if they were not sought.
    distances : (n_q,) distance along a path over 2 pi, in units of 1/d; empty of wave vectors that
        are no path.
    corners, labels : (c,) the same of the corners of the path, and their names.
    """

    qpoints: Array = held(float, "q 3")
    frequencies: Array = held(float, "f", "Hz")
    values: Array = held(float, "q f", "1/Hz")
    by_motion: Array = held(float, "q f m", "1/Hz")
    letters: tuple[str, ...] = held((str, ...))
    damping: float = held(float, unit="Hz")
    edges: Array = held(float, "q b 2", "Hz")
    waves: SurfaceBranches | None = held(SurfaceBranches, "?", default=None)
    distances: Array = held(float, "*", "1", default_factory=lambda: np.zeros(0))
    corners: Array = held(float, "c", "1", default_factory=lambda: np.zeros(0))
    labels: tuple[str, ...] = held((str, ...), "c", default=())

    def write_csv(
        self,
        path: str | os.PathLike[str],
        errors: ArrayLike | None = None,
        weight_errors: ArrayLike | None = None,
    ) -> None:
        """Write a table of the ``waves``: a row for each, with its wave vector, and the distance
        along the path, nan of wave vectors that are no path; with ``errors`` (n,), Hz, also the
        standard error of each frequency, and with ``weight_errors`` (n,) that of each weight, nan
        where it is not known. A table with the same headings is replaced.

        Raises :class:`~granphon.base.errors.InputError` for a spectrum without waves, for errors of
        another number than waves or below zero, and for what is no path;
        :class:`~granphon.base.errors.FileExistsInRunError` if another file is there; and
        :class:`~granphon.base.errors.OutputError` if the file system refuses the file.
        """
        waves = self.waves
        if waves is None:
            raise InputError("the spectrum holds no waves of the edge", mend="Take Surface.map")
        distances = self.distances
        if not len(distances):  # wave vectors that are no path
            distances = np.full(len(self.qpoints), np.nan)
        headings = [
            Heading("distance", "1/d"),
            Heading("q1", ""),
            Heading("q2", ""),
            Heading("q3", ""),
            Heading("frequency", "Hz"),
            Heading("width", "Hz"),
            Heading("weight", ""),
        ]
        columns = [
            distances[waves.place],
            *self.qpoints[waves.place].T,
            waves.frequencies,
            waves.widths,
            waves.weight,
        ]
        count = (len(waves.frequencies),)
        if errors is not None:
            headings.append(Heading("frequency", "Hz").of_error)
            columns.append(read_errors("errors", errors, count))
        if weight_errors is not None:
            headings.append(Heading("weight", "").of_error)
            columns.append(read_errors("weight_errors", weight_errors, count))
        write_text(path, table_text(headings, np.transpose(columns).tolist()))


class Surface:
    """The half space of a crystal above which there is an edge.

    Parameters
    ----------
    x : a state at one load, of a packing or a crystal, or a :class:`~granphon.ContactNetwork` with
        periods.
    axis : across the edge, as for :meth:`ContactNetwork.cut`. The layers go on without end from the
        lower face of that cut.
    edge : "free", "clamped", "floor", or a :class:`~granphon.Wall`.

    Attributes
    ----------
    network : the network of the crystal. Contacts at the edge have its stiffnesses.
    half_space : the half space in reduced units, from which all results are computed.

    Wave vectors q are (n_q, p - 1), or (n_q, 3), in fractions of the reciprocal cell of
    ``network.cut(axis, layers)``, where p is the number of periods of the network. They are
    (n_q, 0) at the end of a chain, for which they may be left out. Methods raise InputError for no
    wave vector, another shape, numbers that are not finite, and wave vectors that leave the edge;
    and PrecisionError for wave vectors of more than 1e15 reciprocal vectors.

    Raises
    ------
    InputError : something without a network; another ``edge``; an ``axis`` that
        :meth:`ContactNetwork.cut` refuses; motions that deform no contact; layers that no contact
        joins, or too large for the memory; and under prestress, static tangential forces or
        torques, and slip by levers that exceed the arms.
    """

    def __init__(self, x: Any, axis: Any, edge: str | Wall = "free") -> None:
        """Cut the half space; its waves are found when they are needed."""
        self.network = given_network(x)
        self.half_space = HalfSpace(self.network, axis, require("edge", read_edge, edge))

    def __repr__(self) -> str:
        half = self.half_space
        return (
            f"Surface({half.edge}, {counted(half.per_layer, 'ball')} in a layer,"
            f" {', '.join(half.motions.letters)} of each ball)"
        )

    @property
    def _frequency(self) -> float:
        """Frequency that is one in reduced units, Hz."""
        return self.half_space.units.frequency

    @cached_property
    def cell(self) -> Array:
        """(p - 1, d) periods of a layer, m; read-only. They are those of a cut, whose periods are
        turned to lie along x or in the xy plane; :attr:`network` is not turned.
        """
        return read_only(self.half_space.layers.cell)

    @property
    def outer(self) -> ContactNetwork:
        """The outer layers with the wall of the edge, from which the half space goes on."""
        return self.half_space.cut

    def _read_wave_vectors(self, q: ArrayLike | None) -> tuple[Array, Array]:
        """Return wave vectors q as (n_q, p - 1) and as (n_q, 3), in fractions of the reciprocal
        cell; at the end of a chain, the only one there is if q is None.

        Raises :class:`~granphon.base.errors.InputError` for no wave vector, another shape, numbers
        that are not finite, and wave vectors that leave the edge, and
        :class:`~granphon.base.errors.PrecisionError` for wave vectors too far from Gamma.
        """
        n_along = len(self.cell)  # periods along the edge
        at_chain_end = q is None and n_along == 0
        fractions = np.zeros((1, 0)) if at_chain_end else real_array("q", q)
        are_vectors = fractions.ndim == 2 and fractions.shape[1] in (n_along, 3)
        if fractions.ndim and not len(fractions):
            mend = f"Give (n, {n_along}) fractions"
            raise InputError("q is empty: there is no wave vector", mend=mend)
        if not are_vectors:
            raise InputError(
                f"the wave vectors have the shape {fractions.shape}",
                f"This edge has {counted(n_along, 'period')}",
                f"Give (n, {n_along}) fractions",
            )
        if not np.all(np.isfinite(fractions)):
            raise InputError("a wave vector is not finite")
        if np.any(fractions[:, n_along:]):
            raise InputError("a wave vector leaves the edge", mend=f"Give (n, {n_along}) fractions")
        along_edge = fractions[:, :n_along]
        require_digits(along_edge)
        return along_edge, np.pad(along_edge, ((0, 0), (0, 3 - n_along)))

    def path(self, npoints: int = 31) -> tuple[Array, Array, Array, tuple[str, ...]]:
        """Return the path from corner to corner of the zone of a layer, ``npoints`` in each
        segment.

        The path is that of the bands of a cut. Returned are wave vectors (n_q, 3) in fractions of
        the reciprocal cell, with a corner where two segments join once; distances (n_q,) along the
        path over 2 pi, 1/d; the distances (c,) and the names of the corners, "K|M" where the path
        jumps from K to M. At the end of a chain there is one wave vector, and no corner. Raises
        :class:`~granphon.base.errors.InputError` for ``npoints`` that is no whole number from 2 on,
        or that does not fit into memory, except at the end of a chain.
        """
        p = len(self.cell)
        if not p:
            return np.zeros((1, 3)), np.zeros(1), np.zeros(0), ()
        vectors = self.cell[:, :p] / self.half_space.units.length
        repeats = [True] * p
        letters = special_points(vectors, repeats)
        corners = default_letters(vectors, repeats)
        # (segments, points of a segment, 3)
        segments, labels = interpolate_path(corners, npoints, letters, periods=p)
        points = segments[..., :p] @ np.linalg.inv(vectors).T  # Cartesian, over 2 pi
        steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
        after_step = np.cumsum(steps).reshape(steps.shape)
        starts = np.concatenate([[0.0], after_step[:-1, -1]])
        distances = np.concatenate([starts[:, None], after_step], axis=1)
        # a corner where two segments join is there once, and twice where the path jumps
        is_jump = np.array(["|" in label for label in labels[1:-1]], bool)
        is_listed = np.ones(distances.shape, bool)
        is_listed[1:, 0] = is_jump
        corner_distances = np.concatenate([starts, after_step[-1:, -1]])
        return segments[is_listed], distances[is_listed], corner_distances, labels

    def corners(self) -> dict[str, Array]:
        """Return the corners of :meth:`path`, each once: the wave vectors (3,), fractions of the
        reciprocal cell, by their letters. At the end of a chain there is one, with an empty name.
        """
        q, _, _, labels = self.path(2)  # whose points are the corners, two where the path jumps
        letters = [letter for label in labels for letter in label.split("|")] or [""]
        return dict(zip(letters, q, strict=True))

    def continuum(self, q: ArrayLike | None = None) -> Array:
        """Return the lowest and the highest frequency (n_q, b, 2), Hz, of each branch of the
        crystal over all wave vectors across the edge, at each q along it.

        Branches are ordered by frequency, and are those of a cell that spans as many layers as
        contacts reach across. Raises :class:`~granphon.base.errors.InstabilityError` if static
        forces make a squared frequency negative. :class:`Surface` says which wave vectors are
        refused.
        """
        return self._find_band_edges(self._read_wave_vectors(q)[0])

    def _find_band_edges(self, fractions: Array) -> Array:
        """Return what :meth:`continuum` does, at wave vectors ``fractions`` (n_q, p - 1) of the
        reciprocal cell, with the same error.
        """
        squares = self.half_space.bands(fractions)
        lowest = squares[:, 0, 0]
        is_unstable = lowest < -_ROUNDED_SQUARE * squares[:, -1, 1]
        if np.any(is_unstable):
            number = int(np.argmin(np.where(is_unstable, lowest, np.inf)))
            raise InstabilityError(
                f"the crystal buckles: at q = {fractions[number].tolist()} along the edge a squared"
                f" frequency is negative, {lowest[number]:.3g} k/M",
                "The contact forces push the balls sideways more than the contacts hold them",
                "Lower the load, or leave static forces out (prestress=False)",
            )
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)) * self._frequency)

    def spectrum(
        self, q: ArrayLike | None, frequencies: ArrayLike, damping: float | None = None
    ) -> SurfaceSpectrum:
        """Return the spectrum of the outer layer, resolved by motion.

        Parameters
        ----------
        q : wave vectors (n_q, p - 1) or (n_q, 3), fractions of the reciprocal cell of a layer.
        frequencies : (n_f,) Hz, zero or above.
        damping : full width at half maximum of an undamped wave's line, Hz, by default the largest
            step of the frequencies. Each mass M feels the drag -M gamma v, with gamma = 2 pi times
            the damping. The spectrum is (2 omega/pi) times the imaginary part of -G(omega^2 + i
            gamma omega), where G is the Green's function; each line has the integral 1 over
            positive frequencies. Below 1e-7 of an upper bound of all frequencies, where the
            spectrum has no digits, it is that at this frequency.

        Raises :class:`~granphon.base.errors.InputError` for frequencies of another shape than
        (n_f,), numbers out of range, frequencies without a step from which the damping would
        follow, and spectra that do not fit into memory; and
        :class:`~granphon.base.errors.InstabilityError` as :meth:`continuum` does. :class:`Surface`
        says which wave vectors are refused.
        """
        fractions, points = self._read_wave_vectors(q)
        half = self.half_space
        unit = self._frequency
        hertz = finite_array("frequencies", frequencies, low="zero or above")
        if hertz.ndim != 1 or not hertz.size:
            raise InputError(f"frequencies have the shape {hertz.shape}", mend="Give (n,) in Hz")
        if damping is None and not np.any(np.diff(hertz)):
            raise InputError("the frequencies have no step", mend="Give damping in Hz")
        largest_step = np.max(np.abs(np.diff(hertz))) if damping is None else damping
        width = positive("damping", largest_step, "Hz")
        n_points = len(points)
        n_frequencies = len(hertz)
        self._require_memory(n_points, n_frequencies)
        edges = self._find_band_edges(fractions)
        reduced = np.maximum(hertz / unit, _LOWEST_FREQUENCY * np.sqrt(half.highest))
        damped_squares = reduced * (reduced + 1j * width / unit)  # omega^2 + i gamma omega
        numbers = np.repeat(np.arange(n_points), n_frequencies)
        inverse = half.inverse_green(fractions, numbers, np.tile(damped_squares, n_points))
        diagonal = np.diagonal(np.linalg.inv(inverse), axis1=1, axis2=2).imag
        by_ball = diagonal.reshape(n_points, n_frequencies, -1, half.motions.count)
        outer_layer = by_ball[:, :, : half.per_layer].mean(axis=2)
        by_motion = -2.0 / np.pi * reduced[:, None] * outer_layer / unit
        return SurfaceSpectrum(
            points,
            hertz,
            values=by_motion.mean(axis=2),
            by_motion=by_motion,
            letters=tuple(half.motions.letters),
            damping=width,
            edges=edges,
        )

    def map(
        self,
        npoints: int = 31,
        frequencies: ArrayLike | None = None,
        damping: float | None = None,
        leaky: bool = False,
    ) -> SurfaceSpectrum:
        """Return :meth:`spectrum` along :meth:`path`, with the :meth:`branches` there as its
        ``waves``: ready to be drawn.

        Parameters
        ----------
        npoints : wave vectors in each segment of the path, both ends counted.
        frequencies : (n_f,) Hz; by default 241 from zero to just above the crystal's bands.
        damping, leaky : as in :meth:`spectrum` and :meth:`branches`.

        Errors are those of these three methods.
        """
        wants_leaky_waves = require("leaky", truth, leaky)
        q, distances, corners, labels = self.path(npoints)
        if frequencies is None:
            self._require_memory(len(q), N_FREQUENCIES)
            highest = float(np.max(self.continuum(q)))
            frequencies = np.linspace(0.0, _TOP_OF_MAP * highest, N_FREQUENCIES)
        spectrum = self.spectrum(q, frequencies, damping)
        waves = self.branches(q, leaky=True) if wants_leaky_waves else self.along_path(npoints)
        return replace(spectrum, waves=waves, distances=distances, corners=corners, labels=labels)

    def branches(
        self, q: ArrayLike | None = None, leaky: bool = False, free: bool = False
    ) -> SurfaceBranches:
        """Return the waves of the edge at q (n_q, p - 1): poles outside of the crystal's bands, all
        of them, to 1e-10.

        ``leaky`` adds resonances within the bands, if their width is below a tenth of their
        frequency and a fiftieth of their energy is in the top layer, and if a pole, which has their
        frequency and width, lies straight below the real axis. Motions at zero frequency deform no
        contact and are no waves. ``free`` lists these motions too, if a thousandth of their energy
        is in the outer layers, also in a crystal whose bulk has such motions. Wave vectors nearer
        to Gamma than 1e-4 of the zone lose digits.

        Raises :class:`~granphon.base.errors.InputError` for flags that are not true or false, and
        for waves that do not fit into memory; and, under prestress,
        :class:`~granphon.base.errors.InstabilityError` as :meth:`continuum` does. :class:`Surface`
        says which wave vectors are refused.
        """
        fractions, points = self._read_wave_vectors(q)
        wants_leaky_waves = require("leaky", truth, leaky)
        wants_free_motions = require("free", truth, free)
        self._require_memory(len(points), _N_SEARCHED)
        if self.network.prestress:
            self._find_band_edges(fractions)  # refuses a crystal that buckles
        waves = [self.half_space.find_waves(fractions)]
        if wants_leaky_waves:
            waves.append(self.half_space.find_leaky_waves(fractions))
        if wants_free_motions:
            waves.append(self.half_space.find_free_motions(fractions))
        number = np.concatenate([kind.point for kind in waves])
        squares = np.concatenate([kind.squares for kind in waves])
        weight = np.concatenate([kind.weight for kind in waves])
        # the energy of a leaky wave decays by twice the imaginary part
        frequencies = np.sqrt(squares.astype(complex)) * self._frequency
        widths = np.maximum(-2.0 * frequencies.imag, 0.0)
        order = np.lexsort((frequencies.real, number))
        return SurfaceBranches(
            points, number[order], frequencies.real[order], widths[order], weight[order]
        )

    def sensitivities(self, q: ArrayLike | None = None) -> SurfaceSensitivities:
        """Return the derivatives of the frequencies of all :meth:`branches` at q (n_q, p - 1) with
        respect to the stiffnesses and static forces of all contacts, and the masses and moments of
        inertia of all balls.

        Waves of one frequency, to 1e-8 of it, have the derivative of their mean. Leaky waves, whose
        frequencies are complex, and motions without energy are not among them.

        Raises :class:`~granphon.base.errors.InputError` for waves or derivatives that do not fit
        into memory, :class:`~granphon.base.errors.InstabilityError` as :meth:`branches` does, and
        :class:`~granphon.base.errors.PrecisionError` for a wave so near to an edge of a band that
        it cannot be told from waves of the bulk. :class:`Surface` says which wave vectors are
        refused.
        """
        fractions, _ = self._read_wave_vectors(q)
        waves = self.branches(q)
        squares = (waves.frequencies / self._frequency) ** 2
        warnings = network_warnings(self.network)
        energies = EdgeEnergies(self.half_space)
        of_crystal, of_outer_layers = energies.find_sensitivities(
            waves.place, fractions, squares, warnings
        )
        return SurfaceSensitivities(waves, of_crystal, of_outer_layers)

    def _require_memory(self, points: int, frequencies: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if spectra at a number of wave vectors,
        ``points``, and a number of ``frequencies`` at each do not fit into memory.
        """
        require_memory(
            f"spectra at {points:,} wave vectors and {frequencies:,} frequencies",
            _estimate_memory(self.half_space.size, points, frequencies),
            "Take fewer wave vectors (npoints), or frequencies",
        )

    def along_path(self, npoints: int) -> SurfaceBranches:
        """Return :meth:`branches` along :meth:`path`, with ``npoints`` in each segment. Errors are
        those of both methods. The branches are kept, as a figure and a data set need the same.
        """
        q = self.path(npoints)[0]
        if len(q) not in self._along_path:
            self._along_path[len(q)] = self.branches(q)
        return self._along_path[len(q)]

    @cached_property
    def _along_path(self) -> dict[int, SurfaceBranches]:
        """The results of :meth:`along_path`, by the number of wave vectors of the path."""
        return {}

    def follow(self, q: ArrayLike, frequency: float) -> Array:
        """Return frequencies (n_q,), Hz, along q (n_q, p - 1), of the wave with about this
        ``frequency``, Hz, at the first.

        Raises :class:`~granphon.base.errors.InputError` for a frequency that is not above zero or
        lies inside of the crystal's bands, and where no wave of the edge is in the gap of the
        frequency, as where the wave enters the bands; and the errors of :meth:`continuum` and
        :meth:`branches`. :class:`Surface` says which wave vectors are refused.
        """
        start = positive("frequency", frequency, "Hz")
        points = self._read_wave_vectors(q)[1]
        continuum = self.continuum(q)
        branches = self.branches(q)
        bottoms, tops = continuum[0].T
        if np.any((bottoms <= start) & (start <= tops)):
            raise InputError(
                f"{start:.6g} Hz lies inside of the crystal's bands at q = {points[0].tolist()}",
                "A wave there leaks into the crystal",
                "Use branches(q, leaky=True)",
            )
        followed = list[float]()
        expected = start
        for n, point in enumerate(points):
            if n > 1:  # on a straight line from the last two
                expected = 2.0 * followed[-1] - followed[-2]
            elif n == 1:
                expected = followed[0]
            nearest = _find_in_gap(branches[n], continuum[n], expected)
            if nearest is None:
                raise InputError(
                    f"no wave of the edge is near {expected:.6g} Hz at q = {point.tolist()}",
                    mend="Give fewer wave vectors, or another frequency",
                )
            followed.append(nearest)
        return np.array(followed)

    def zak_phase(self, q: ArrayLike | None = None, below: int = 1) -> Array:
        """Return the Zak phase (n_q,), rad, 0 to 2 pi, at q (n_q, p - 1), of the branches above the
        ``below`` lowest ones.

        At a free edge it is the phase of the deformations of contacts, else of the motions of
        balls. Where symmetry leaves only 0 and pi, pi means a wave of the edge in the gap above the
        ``below`` lowest branches.

        Raises :class:`~granphon.base.errors.InputError` for a crystal with one branch, which has
        no gap; for another number ``below`` than 1 to one less than all branches; where the gap
        closes; and at a free edge under prestress. :class:`Surface` says which wave vectors are
        refused.
        """
        half_space = self.half_space
        if half_space.size == 1:
            raise InputError(
                "the crystal has one branch",
                "There is no gap between branches",
                "Take a crystal of more balls in a cell, or of more motions",
            )
        n_below = whole_number("below", below, 1, half_space.size - 1)
        points = self._read_wave_vectors(q)[0]
        return np.array([find_zak_phase(half_space, point, n_below) for point in points])

    def winding(self, q: ArrayLike | None = None) -> NDArray[np.intp]:
        """Return the winding (n_q,) of det C at q (n_q, p - 1): the number of motions at a free
        edge that cost nothing.

        C is the compatibility matrix, from motions of balls to deformations of contacts.

        Raises :class:`~granphon.base.errors.InputError` unless contacts resist as many deformations
        as balls have motions (an isostatic lattice), where det C vanishes, and where springs to the
        ground hold balls. :class:`Surface` says which wave vectors are refused.
        """
        points = self._read_wave_vectors(q)[0]
        return np.array([find_winding(self.half_space, point) for point in points], np.intp)

    def velocity(self, direction: ArrayLike | None = None) -> float:
        """Return the velocity of the long wave along a free edge, m/s: Rayleigh's, of the crystal's
        elastic tensor.

        ``direction`` is (p - 1,) in the frame of the cut, by default along x; or (p,) in the
        crystal's, along the edge. At shorter waves the velocity changes in proportion to q;
        :meth:`branches` have it.

        Raises :class:`~granphon.base.errors.InputError` for a chain, whose edge is a single ball;
        for an edge that is held, for balls that do not move along it and across it, for a
        mechanism, for two periods in space that are not in the xy plane, and for a direction that
        leaves the edge, is zero, has another shape or is not finite;
        :class:`~granphon.base.errors.GranphonError` if no long wave runs along the direction.
        """
        n_along = len(self.cell)  # periods along the edge
        if not n_along:
            fault = "the edge of a chain is no line along which a wave runs"
            raise InputError(fault, mend="Use branches(), the frequencies of waves at the edge")
        vector = np.eye(n_along)[0]
        if direction is not None:
            vector = real_array("direction", direction)
        is_in_cut = vector.shape != (n_along + 1,)
        along = one_direction(vector, n_along if is_in_cut else n_along + 1)
        if not is_in_cut:
            # from the frame of the crystal to that of the cut, whose last axis leaves the edge
            turned = self.half_space.layers.turn[: n_along + 1, : n_along + 1] @ along
            if abs(turned[n_along]) > _ROUNDING:
                raise InputError("the direction leaves the edge", mend="Give one along it")
            along = turned[:n_along]
        unit = self.half_space.units.velocity
        return float(unit * self.half_space.rayleigh_velocity(along))


def estimate_waves_memory(size: int, points: int) -> float:
    """Return the memory of the waves of an edge at a number of wave vectors, ``points``, of a half
    space whose blocks have ``size`` motions, bytes.
    """
    return _estimate_memory(size, points, _N_SEARCHED)


def _estimate_memory(size: int, points: int, frequencies: int) -> float:
    """Return the memory, bytes, of spectra at a number of wave vectors, ``points``, and a number of
    ``frequencies`` at each, of a half space whose blocks have ``size`` motions.
    """
    return _SPECTRUM_BYTES * size**2 * points * float(frequencies)


def _find_in_gap(waves: Array, bands: Array, expected: float) -> float | None:
    """Return the frequency, Hz, among ``waves`` (n_w,), Hz, that is nearest to the ``expected``
    one, between the nearest of the ``bands`` (b, 2), Hz, that lie below and above it; None if no
    wave is there.
    """
    bottoms, tops = bands.T
    # the ends of the gap in which the expected frequency lies, if it lies in one
    low = np.max(tops, where=tops < expected, initial=0.0)
    high = np.min(bottoms, where=bottoms > expected, initial=np.inf)
    in_gap = waves[(waves > low) & (waves < high)]
    if not in_gap.size:
        return None
    return float(in_gap[np.argmin(np.abs(in_gap - expected))])


def observe_surface(
    states: Sequence[State],
    distinct_states: Sequence[State],
    axis: Any,
    edge: str | Wall,
    points: int,
) -> dict[str, Array]:
    """Return the waves at an edge at each of n loads, which a run keeps, by the names of the
    catalogue.

    The names are "surface_frequency", Hz, and "surface_weight" (n, n_q, n_w) along
    :meth:`Surface.path` with ``points`` in each segment, nan where a wave vector has fewer waves;
    the path itself, "surface_qpoint" (n, n_q, 3) and "surface_distance" (n, n_q); and if there is a
    long wave at all loads, "surface_velocity" (n,), m/s, along the first segment of the path.
    ``axis`` and ``edge`` are those of :class:`Surface`. ``distinct_states`` are the ``states``, or
    the first state alone if all have one lattice in reduced units.
    """
    surfaces = [state.cached(Surface, axis, edge) for state in distinct_states]
    paths = [surface.path(points) for surface in surfaces]
    q = paths[0][0]
    branches = [surface.along_path(points) for surface in surfaces]
    # from the units of the surfaces to those of the states
    of_states = np.array([[state.scales.frequency, state.scales.velocity] for state in states])
    of_surfaces = [[state.scales.frequency, state.scales.velocity] for state in distinct_states]
    frequency_ratio, velocity_ratio = (of_states / of_surfaces).T
    frequencies, weights = _tabulate_waves(branches, len(q))
    distances = np.array([path[1] for path in paths])
    observed = {
        "surface_distance": np.broadcast_to(distances, (len(states), len(q))),
        "surface_qpoint": np.broadcast_to(q, (len(states), *q.shape)),
        "surface_frequency": frequency_ratio[:, None, None] * frequencies,
        "surface_weight": np.broadcast_to(weights, (len(states), *weights.shape[1:])),
    }
    direction = None
    if len(q) > 1:
        p = len(surfaces[0].cell)
        direction = q[1, :p] @ np.linalg.inv(surfaces[0].cell[:, :p]).T
    with suppress(GranphonError):  # not every edge has a long wave
        velocities = [surface.velocity(direction) for surface in surfaces]
        observed["surface_velocity"] = velocity_ratio * velocities
    return observed


def _tabulate_waves(branches: Sequence[SurfaceBranches], n_q: int) -> tuple[Array, Array]:
    """Return the frequencies, Hz, and the weights, both (surfaces, n_q, n_w), of the waves of
    several surfaces, ``branches``, at the same ``n_q`` wave vectors; nan where a wave vector has
    fewer waves than another.
    """
    counts = [int(np.bincount(waves.place, minlength=1).max()) for waves in branches]
    shape = (len(branches), n_q, max(1, *counts))
    frequencies = np.full(shape, np.nan)
    weights = np.full(shape, np.nan)
    for number, waves in enumerate(branches):
        # the rank of each wave among those of its wave vector
        rank = np.arange(len(waves.place)) - np.searchsorted(waves.place, waves.place)
        frequencies[number, waves.place, rank] = waves.frequencies
        weights[number, waves.place, rank] = waves.weight
    return frequencies, weights
