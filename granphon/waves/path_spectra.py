"""Spectral functions along a path through the Brillouin zone of an array, beside the bands of its
mean lattice.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.results import Result, held, result_class
from granphon.base.scales import Units
from granphon.base.staging import write_text
from granphon.base.tables import Heading, table_text
from granphon.base.text import require_path
from granphon.base.validation import one_of, real_array, whole_number
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.networks.network import ContactNetwork
from granphon.waves.spectral_functions import PeriodicCell, SpectralFunction, nearest_wavevectors
from granphon.waves.waves import Waves

#: rounding of wave vectors: in fractions of the reciprocal cell, where one is compared with Gamma,
#: and over the length of a leg, where the distance from the leg is compared
_ROUNDING = 1e-6
#: points of the bands between two corners
_BAND_POINTS = 101
#: units of the numbers of a line that may have errors, by the names of their columns
_UNITS = {"peak": "Hz", "width": "Hz", "mean_free_path": "m", "attenuation": "1/m"}


@result_class
class PathSpectra(Result):
    """Spectral functions of an array at wave vectors of its cell along a path, and the bands of its
    mean lattice.

    Attributes
    ----------
    corners : (m,) distances of the corners along the path, 1/m.
    labels : names of the corners, one for each.
    distances : (n,) distances of the wave vectors along the path, 1/m. Wave vectors are those of
        the cell of the array that are nearest to points of the path, without Gamma.
    spectra : for each polarisation, one or more, the spectral function at these n wave vectors.
    band_distances : (b,) distances of the wave vectors of the bands along the path, 1/m.
    bands : (b, n_branches) frequencies of the lattice of equal contacts with the mean stiffness,
        Hz; empty for a packing, which has no lattice.
    """

    corners: Array = held(float, "c", "1/m")
    labels: tuple[str, ...] = held((str, ...), "c")
    distances: Array = held(float, "n", "1/m")
    spectra: tuple[SpectralFunction, ...] = held((SpectralFunction, ...))
    band_distances: Array = held(float, "b", "1/m")
    bands: Array = held(float, "b m", "Hz")

    @classmethod
    def of_packing(
        cls,
        spectra: Sequence[SpectralFunction],
        corners: Array,
        distances: Array,
        path: Sequence[ArrayLike],
        labels: Sequence[str],
    ) -> Self:
        """Return the ``spectra`` of a packing, without bands, as a packing has no lattice.

        ``spectra`` are those at wave vectors with the ``distances`` (n,), 1/m, along the ``path``,
        and ``corners`` (m,), 1/m, are the distances of its corners. ``labels`` name the corners of
        all pieces of the path, and :func:`join_labels` joins the two names at each jump.
        """
        corner_labels = join_labels(path, labels)
        no_distances = np.zeros(0)
        no_bands = np.zeros((0, 0))
        return cls(corners, corner_labels, distances, tuple(spectra), no_distances, no_bands)

    @classmethod
    def of(
        cls,
        spectra: Sequence[SpectralFunction],
        corners: Array,
        distances: Array,
        lattice: ContactLattice,
        scales: Units,
        path: Sequence[ArrayLike],
        labels: Sequence[str],
    ) -> Self:
        """Return the ``spectra`` together with the bands of a ``lattice`` along the ``path``. Bands
        are computed at :data:`_BAND_POINTS` points from each corner to the next, both counted.

        ``spectra`` are those at wave vectors with the ``distances`` (n,), 1/m, and ``corners``
        (m,), 1/m, are the distances of the corners; the other arguments are those of
        :func:`find_path_spectra`.
        """
        steps = np.linspace(0.0, 1.0, _BAND_POINTS)[:, None]  # parts of the length of a leg
        band_distances = corners[:-1] + steps * np.diff(corners)  # (points of a leg, legs)
        bands = []
        for piece in path:
            for start, end in pairwise(lattice.wavevectors(piece)):
                bands.append(lattice.frequencies(start + steps * (end - start)))
        hertz = scales.frequency * np.concatenate(bands)
        corner_labels = join_labels(path, labels)
        return cls(
            corners, corner_labels, distances, tuple(spectra), band_distances.T.ravel(), hertz
        )

    @property
    def numbers(self) -> dict[str, Array]:
        """The numbers (polarisations, n) of the lines, by the names of their columns in
        :meth:`write_csv`: peak and width, Hz, mean_free_path, m, and attenuation, 1/m. Raises what
        these attributes of :class:`SpectralFunction` raise.
        """
        return {
            name: np.array([getattr(spectrum, name) for spectrum in self.spectra])
            for name in _UNITS
        }

    def write_csv(
        self, path: str | os.PathLike[str], errors: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Write a table of peaks into a file at ``path``: a row for each wave vector and
        polarisation.

        The columns are the polarisation, the distance along the path and the wave vector, 1/m, peak
        and width, Hz, whether the width is resolved (1 or 0), the mean free path, m, and the
        attenuation, 1/m. ``errors`` are standard errors (polarisations, n), in the units of the
        columns, by the names of :attr:`numbers`; further columns, such as peak_error, hold these.

        An earlier table with the same columns is replaced. Raises
        :class:`~granphon.base.errors.InputError` for errors of another name or shape, or that are
        no numbers, if ``path`` is no path, and for spectra whose :attr:`numbers` are not known; and
        :class:`~granphon.base.errors.OutputError` if another file is there, also a table with other
        columns, or the file cannot be written.
        """
        require_path(path)
        tables = self._read_errors(errors or {})
        names = [f"q{axis}" for axis in "xyz"[: self.spectra[0].q.shape[1]]]
        headings: list[Heading | str] = [
            "polarisation",
            Heading("distance", "1/m"),
            *(Heading(name, "1/m") for name in names),
            Heading("peak", "Hz"),
            Heading("width", "Hz"),
            "resolved",
            Heading("mean_free_path", "m"),
            Heading("attenuation", "1/m"),
        ]
        headings += [Heading(name, _UNITS[name]).of_error for name in tables]
        rows: list[tuple[Any, ...]] = []
        for number, spectrum in enumerate(self.spectra):
            columns = [
                [spectrum.polarisation for _ in self.distances],
                self.distances.tolist(),
                *spectrum.q.T.tolist(),
                spectrum.peak.tolist(),
                spectrum.width.tolist(),
                spectrum.resolved.astype(int).tolist(),
                spectrum.mean_free_path.tolist(),
                spectrum.attenuation.tolist(),
                *(table[number].tolist() for table in tables.values()),
            ]
            rows.extend(zip(*columns, strict=True))
        write_text(path, table_text(headings, rows))

    def _read_errors(self, errors: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Return the ``errors`` of :meth:`write_csv` as arrays (polarisations, n), by name; raises
        :class:`~granphon.base.errors.InputError` for errors of another name or shape, or that are
        no numbers.
        """
        shape = (len(self.spectra), self.distances.size)
        tables: dict[str, Array] = {}
        for name, values in errors.items():
            table = real_array("errors", values)
            if table.shape != shape:
                fault = f"the errors of {name} have the shape {table.shape}"
                raise InputError(fault, mend=f"Give an array {shape}")
            tables[one_of("the column with an error", name, _UNITS)] = table
        return tables


def find_path_spectra(
    waves: Waves,
    lattice: ContactLattice,
    scales: Units,
    path: Sequence[Array],
    labels: Sequence[str],
    *,
    points: int,
    polarisations: Sequence[str],
    resolution: float | None = None,
) -> PathSpectra:
    """Return the spectral functions of an array along a path, and the bands of its mean lattice.

    Parameters
    ----------
    waves : the waves of the array.
    lattice, scales : the lattice of equal contacts with the mean stiffness, whose bands are drawn
        beside the spectra, and its units.
    path : pieces of the path, each the corners (n_corners, p) or (n_corners, 3) of a line without
        a jump, in fractions of the reciprocal cell. No corner is the same as the one before it.
    labels : names of the corners, one for each.
    points : number of points from each corner to the next, both counted. If the same wave vector of
        the cell is nearest to several points, it counts once.
    polarisations, resolution : see :meth:`~granphon.waves.waves.Waves.spectral_function`; the
        resolution is in Hz.

    Raises
    ------
    InputError : fewer than two points, an array so small that it has no wave vector on the path
        but Gamma, or what :meth:`~granphon.waves.waves.Waves.spectral_function` refuses.
    """
    route = find_path_points(waves.network, lattice, scales.length, path, points)
    spectra = [waves.spectral_function(route.q, name, resolution) for name in polarisations]
    return PathSpectra.of(spectra, route.corners, route.distances, lattice, scales, path, labels)


class PathPoints(NamedTuple):
    """Wave vectors of the cell of a periodic network along a path.

    Attributes
    ----------
    corners : (m,) distances of the corners along the path, 1/m.
    distances : (n,) distances of the wave vectors along the path, 1/m.
    q : (n, d) wave vectors, 1/m.
    """

    corners: Array
    distances: Array
    q: Array


class _Leg(NamedTuple):
    """A straight leg of a path from ``start`` (p,) to ``end`` (p,), 1/m, with its ``length`` and
    the ``distance`` of its start along the path, 1/m.
    """

    start: Array
    end: Array
    length: float
    distance: float

    def place_points(self, count: int) -> Array:
        """Return ``count`` points (count, p), 1/m, that divide the leg evenly, with both ends."""
        shares = np.linspace(0.0, 1.0, count)[:, None]
        return np.asarray(self.start + shares * (self.end - self.start))

    def measure(self, q: Array) -> tuple[float, float]:
        """Return the distance along the path of the point of the leg that is nearest to ``q`` (p,),
        and the distance of q from that point, 1/m.
        """
        unit_vector = (self.end - self.start) / self.length
        distance_on_leg = float(np.clip((q - self.start) @ unit_vector, 0.0, self.length))
        offset = q - self.start - distance_on_leg * unit_vector
        return self.distance + distance_on_leg, float(np.linalg.norm(offset))


def _list_legs(pieces: Sequence[Array]) -> tuple[list[_Leg], Array]:
    """Return the legs between the corners of the ``pieces`` of a path, each piece (corners, p),
    1/m; and the distances (m,), 1/m, along the path: of the start of the first leg, and of the end
    of each leg.

    A jump from one piece to the next has no length.
    """
    ends = list(chain.from_iterable(pairwise(piece) for piece in pieces))
    lengths = [float(np.linalg.norm(end - start)) for start, end in ends]
    corners = np.concatenate([[0.0], np.cumsum(lengths)])
    legs = [
        _Leg(start, end, length, distance)
        for (start, end), length, distance in zip(ends, lengths, corners[:-1], strict=True)
    ]
    return legs, corners


def _gather_points(
    corners: Array, wavevectors: Mapping[tuple[int, ...], tuple[float, Array]]
) -> PathPoints:
    """Return the points of a path with the distances ``corners`` (m,), 1/m, of its corners, from
    the distance, 1/m, and the wave vector (d,), 1/m, of each point, in their order.

    The keys of ``wavevectors``, numbers of waves along the periods of the cell, tell the wave
    vectors apart, and are left out.
    """
    distances = np.array([distance for distance, _ in wavevectors.values()])
    q = np.array([wavevector for _, wavevector in wavevectors.values()])
    return PathPoints(corners, distances, q)


def find_path_points(
    network: ContactNetwork | PeriodicCell,
    lattice: ContactLattice,
    spacing: float,
    path: Sequence[ArrayLike],
    points: int,
) -> PathPoints:
    """Return the wave vectors of the cell of a ``network`` that are nearest to ``points`` points on
    each leg of a path, as waves with a whole number of periods in the cell.

    Left out are wave vectors of Gamma, those farther off the path than half the distance of two
    points, and repeated ones. ``spacing`` is the unit of length of the ``lattice``, m. The ``path``
    is that of :func:`find_path_spectra`. Raises :class:`~granphon.base.errors.InputError` for fewer
    than two points, and if no wave vector is left; and what :func:`nearest_wavevectors` raises.
    """
    count = whole_number("points", points, 2)
    pieces = [lattice.wavevectors(piece) / spacing for piece in path]  # (corners, p), 1/m
    legs, corners = _list_legs(pieces)
    p = len(pieces[0][0])
    d = network.dimension
    periods = network.cell[list(network.pbc)][:, :d]
    # multiplied by this matrix, a wave vector is in fractions of the reciprocal cell
    to_fractions = np.linalg.inv(lattice.wavevectors(np.eye(p)) / spacing)
    # distances and wave vectors; the key is the number of waves along each period of the cell
    wavevectors: dict[tuple[int, ...], tuple[float, Array]] = {}
    for leg in legs:
        half_step = 0.5 * leg.length / (count - 1)
        targets = np.zeros((count, d))
        targets[:, :p] = leg.place_points(count)
        for q in nearest_wavevectors(network, targets):
            distance, deviation = leg.measure(q[:p])
            fractions = q[:p] @ to_fractions
            is_gamma = np.all(np.abs(fractions - np.rint(fractions)) <= _ROUNDING)
            if not is_gamma and deviation <= half_step:
                waves_along_periods = np.rint(periods @ q / (2.0 * np.pi))
                numbers = tuple(waves_along_periods.astype(int).tolist())
                wavevectors.setdefault(numbers, (distance, q))
    if not wavevectors:
        fault = "the array has no wave vector on the path but Gamma"
        raise InputError(
            fault, mend="Take a larger array, or a path through the middle of the zone"
        )
    return _gather_points(corners, wavevectors)


def find_packing_points(
    network: ContactNetwork, path: Sequence[ArrayLike], points: int
) -> PathPoints:
    """Return the wave vectors of a packing, a ``network`` without a lattice, that are nearest to
    ``points`` points on each leg of a path. Waves repeat with the cell of the packing, so that each
    wave vector is a sum of whole numbers of its reciprocal vectors.

    The ``path`` has pieces, each the corners (n, p) or (n, 3) of a line without a jump, in
    fractions of the reciprocal vectors of the p periods, in their order; further components are not
    used. Corners may lie in any zone, but none may be the same as the corner before it. Left out
    are the wave vector zero, those farther off the path than half the distance of two points, and
    repeated ones. Raises :class:`~granphon.base.errors.InputError` for fewer than two points, and
    if no wave vector is left; and what :func:`nearest_wavevectors` raises.
    """
    count = whole_number("points", points, 2)
    periods = network.cell[list(network.pbc)][:, : network.dimension]
    reciprocal = 2.0 * np.pi * np.linalg.pinv(periods).T  # (p, d), 1/m
    pieces = [np.asarray(piece)[:, : len(periods)] @ reciprocal for piece in path]
    legs, corners = _list_legs(pieces)
    # distances and wave vectors; the key is the number of waves along each period of the cell
    wavevectors: dict[tuple[int, ...], tuple[float, Array]] = {}
    for leg in legs:
        # half the distance of two points, with room for rounding
        largest_deviation = 0.5 * leg.length / (count - 1) + _ROUNDING * leg.length
        nearest = nearest_wavevectors(network, leg.place_points(count))
        for numbers in np.rint(nearest @ periods.T / (2.0 * np.pi)):  # of waves along periods
            q = numbers @ reciprocal
            distance, deviation = leg.measure(q)
            if np.any(numbers) and deviation <= largest_deviation:
                wavevectors.setdefault(tuple(numbers.astype(int).tolist()), (distance, q))
    if not wavevectors:
        fault = "the path has no wave vector of the packing but zero"
        why = "Those of its cell are whole numbers of reciprocal vectors"
        raise InputError(fault, why, "Take a longer path, as 0 0 0 8 0 0")
    return _gather_points(corners, wavevectors)


def join_labels(path: Sequence[Any], labels: Sequence[str]) -> tuple[str, ...]:
    """Return the labels of the corners along the whole ``path``, from ``labels`` of the corners of
    its pieces in turn: where the path jumps from K to M, both have the one label "K|M".
    """
    joined_labels = list[str]()
    first = 0
    for piece in path:
        piece_labels = labels[first : first + len(piece)]
        first += len(piece)
        if joined_labels:
            joined_labels[-1] = f"{joined_labels[-1]}|{piece_labels[0]}"
        else:
            joined_labels.append(piece_labels[0])
        joined_labels += piece_labels[1:]
    return tuple(joined_labels)
