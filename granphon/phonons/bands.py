"""Band structures, in memory and in phonopy's band.yaml; and complex band structures, which
contain waves that decay as well.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.layers import find_outer
from granphon.balls.motions import IN_PLANE, Motions
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import HertzPrefix, Units, read_header
from granphon.base.staging import write_text
from granphon.base.standard_errors import read_errors
from granphon.base.text import (
    counted,
    fill_floats,
    plain_yaml,
    read_sealed,
    require_own_file,
    seal,
    warn_unverified,
)
from granphon.base.validation import require, truth, whole
from granphon.dynamics.branches import connect_branches
from granphon.dynamics.compatibility import GYRATION
from granphon.dynamics.contact_lattice import Modes
from granphon.phonons.phonopy_atoms import (
    OFFSET,
    find_offset_phases,
    make_header,
    name_atoms,
    place_atoms,
    read_kinds,
    read_motions,
    read_numbers,
    write_kinds,
)

#: difference of frequencies, over the top frequency, up to which branches coincide
_DEGENERACY = 1e-6
#: difference of the heights of balls, over the largest component of the cell, up to which there are
#: no edges
_LEAST_HEIGHT = 1e-9
#: part of the top frequency by which frequencies at one point may be out of order
_ROUNDING = 1e-6
#: highest frequency that bands may have, in units of their scales: that of a stiff contact,
#: (k/M)^(1/2), is of order one
_LARGEST_FREQUENCY = 1e3
#: largest deviation of the length of an eigenvector from one
_LENGTH_ERROR = 1e-6


@result_class
class PhononModes(Modes):
    """:class:`~granphon.dynamics.contact_lattice.Modes` in SI units: Hz, rad/m and m/s;
    eigenvectors are unchanged.
    """

    units = {"wavevectors": "rad/m", "frequencies": "Hz", "group_velocities": "m/s"}


@result_class
class Bands(Result):
    """A band structure: frequencies in Hz, group velocities in m/s and eigenvectors along a path of
    wave vectors.

    The axes of arrays are segments s, points p in a segment, and branches b. A corner where two
    segments join is in both, as in phonopy.

    Attributes
    ----------
    qpoints : (s, p, 3), wave vectors as fractions of the reciprocal cell.
    distances : (s, p), length of the path up to each point, times the mean diameter over 2 pi, as
        in phonopy: a number without a unit.
    frequencies : (s, p, b), Hz, ascending.
    group_velocities : (s, p, b, d), m/s, along the d periods of the lattice; at Gamma, and where
        branches touch or vanish, the limit along the path. None if the bands were made without
        eigenvectors.
    eigenvectors : (s, p, n_dof, b), complex, mass-weighted, orthonormal: the motions, (x, y, w) in
        the plane, of the first ball, then those of the second, and so on. None if the bands were
        made without; fractions and connections, which follow from eigenvectors, then raise
        :class:`~granphon.base.errors.InputError`.
    labels : (s + 1), names of the corners.
    cell : (3, 3), vectors, as rows, of the cell to which the q points belong, in reduced units.
    positions : (n, 3), positions of the balls as fractions of these vectors.
    masses : (n,), masses of the balls in reduced units.
    scales : the length, stiffness and mass that convert reduced units to SI.
    warnings : one sentence for each limit of the model that the state exceeds, and for branches
        that cost no energy.
    motions : the motions of each ball; rotations that the eigenvectors do not have are left out.
    pbc : (d,), whether the cell repeats along each of the d periods of the lattice, by default
        true; a ribbon that is cut out of a lattice in the plane repeats along one. Without group
        velocities ``pbc`` must be given, as its length then tells d.
    kinds : names of the kinds of the balls, if they are known.
    gyration : (n,) radii of gyration of the balls, in reduced units; by default of solid balls with
        the diameter 1.
    """

    qpoints: Array = held(float, "s p 3")
    distances: Array = held(float, "s p", "1")
    frequencies: Array = held(float, "s p b", "Hz")
    group_velocities: Array | None = held(float, "s p b d?", "m/s")
    eigenvectors: Complex | None = held(complex, "s p m b?")
    labels: tuple[str, ...] = held((str, ...), "s+1")
    cell: Array = held(float, "3 3")
    positions: Array = held(float, "n 3")
    masses: Array = held(float, "n")
    scales: Units = held(Units)
    warnings: tuple[str, ...] = held((str, ...), default=())
    motions: Motions = held(Motions, default=IN_PLANE)
    pbc: tuple[bool, ...] = held((bool, ...), default=())
    kinds: tuple[str, ...] = held((str, ...), default=())
    gyration: Any = held(Any, "n", default=None)  # an array from the constructor on

    def __post_init__(self) -> None:
        """Fill in the defaults of ``gyration`` and ``pbc``, and make arrays read-only. The fields
        are checked when they are read from a file or from plain data.
        """
        if self.gyration is None:
            object.__setattr__(self, "gyration", np.full(len(self.masses), GYRATION))
        super().__post_init__()
        if not self.pbc:
            object.__setattr__(self, "pbc", (True,) * self.periods)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless shapes fit together, and all
        numbers are finite and can be those of bands.
        """
        super()._check()
        balls = len(self.masses)
        d = self.periods
        if d not in (1, 2, 3):
            mend = "Without group velocities give pbc, whose length is the number of periods"
            raise InputError(f"the bands have {counted(d, 'period')}", mend=mend)
        if self.eigenvectors is not None:
            components = self.eigenvectors.shape[2]
            if components != self.motions.count * balls:
                raise InputError(
                    f"{components} components of an eigenvector for {balls} balls",
                    mend=f"Give {self.motions.count} for each ball",
                )
        self._require_finite()
        _require(self.frequencies.size > 0, "there is no frequency")
        # the periods are along the first axes; components along the others must be zero
        across = (self.qpoints[..., d:], self.cell[:d, d:], self.cell[d:, :d])
        is_inside = not any(np.any(components) for components in across)
        shape = ("line", "plane", "space")[d - 1]
        _require(is_inside, f"a wave vector or a lattice vector leaves the {shape} of {d} periods")
        _require(np.all(self.frequencies >= 0.0), "a frequency is below zero")
        # the lowest frequencies are roots of rounding errors, which may put neighbours out of order
        falls = -np.diff(self.frequencies, axis=2)
        largest_fall = _ROUNDING * self.frequencies.max(initial=0.0)
        _require(np.all(falls <= largest_fall), "the frequencies at a point do not ascend")
        highest = _LARGEST_FREQUENCY * self.scales.frequency
        _require(
            np.all(self.frequencies <= highest), "a frequency is far above those of the scales"
        )
        steps = np.diff(self.distances.ravel())
        _require(np.all(steps >= 0.0), "the distances along the path do not ascend")
        _require(np.all(self.masses > 0.0), "a mass is not above zero")
        _require(np.all(self.gyration > 0.0), "a radius of gyration is not above zero")
        _require(len(self.kinds) in (0, balls), "kinds are not those of all balls")
        _require(abs(np.linalg.det(self.cell)) > 0.0, "the cell has no volume")
        if self.eigenvectors is not None:
            errors = np.abs(np.linalg.norm(self.eigenvectors, axis=2) - 1.0)
            _require(np.all(errors <= _LENGTH_ERROR), "an eigenvector has not the length one")
        are_flags = len(self.pbc) == d and all(isinstance(repeats, bool) for repeats in self.pbc)
        _require(are_flags, f"pbc is not {d} times true or false")

    @property
    def n_branches(self) -> int:
        """Number of branches: one for each motion of each ball."""
        return int(self.frequencies.shape[2])

    @property
    def periods(self) -> int:
        """Number of periods of the lattice."""
        if self.group_velocities is None:
            return len(self.pbc)
        return int(self.group_velocities.shape[3])

    @cached_property
    def motion(self) -> NDArray[Any]:
        """Eigenvectors with an axis for balls and one for the motions of a ball, (s, p, n_balls,
        motions, b); read-only, as all arrays that bands keep.

        Raises :class:`~granphon.base.errors.InputError` if there are no eigenvectors.
        """
        if self.eigenvectors is None:
            raise InputError(
                "these bands have no eigenvectors", mend="Take bands(eigenvectors=True)"
            )
        s, p, _, b = self.eigenvectors.shape
        return self.eigenvectors.reshape(s, p, len(self.masses), self.motions.count, b)

    @property
    def rotational_fraction(self) -> Array:
        """Fraction of the kinetic energy that is rotation, (s, p, b), 0 to 1."""
        rotations = self.motion[:, :, :, self.motions.turning]
        return np.asarray(np.sum(np.abs(rotations) ** 2, axis=(2, 3)))

    @property
    def longitudinal_fraction(self) -> Array:
        """Fraction of the kinetic energy that is motion along q (at Gamma and its copies, along the
        path), (s, p, b), 0 to 1.
        """
        d = self.periods
        q = self.qpoints[..., :d] @ np.linalg.inv(self.cell[:d, :d]).T  # (s, p, d)
        along_path = np.broadcast_to((q[:, -1] - q[:, 0])[:, None], q.shape)
        fractions = self.qpoints[..., :d]
        is_gamma = np.all(fractions == np.rint(fractions), axis=-1, keepdims=True)
        course = np.where(is_gamma, along_path, q)
        direction = course / np.linalg.norm(course, axis=-1, keepdims=True)
        translations = self.motions.translations
        axes = [axis for axis in translations if axis < d]
        components = [translations.index(axis) for axis in axes]
        displacements = self.motion[:, :, :, components]
        # component along the direction of each ball i: the sum over the axes a
        along = np.einsum("spiab,spa->spib", displacements, direction[..., axes])
        return np.asarray(np.sum(np.abs(along) ** 2, axis=2))

    @property
    def out_of_plane_fraction(self) -> Array:
        """Fraction of the kinetic energy that is displacement out of a plane lattice, (s, p, b), 0
        to 1.

        The fraction is zero for lattices with one or three periods.
        """
        components = list[int]()
        if self.periods == 2 and 2 in self.motions.translations:
            components.append(self.motions.translations.index(2))
        across = self.motion[:, :, :, components]
        return np.asarray(np.sum(np.abs(across) ** 2, axis=(2, 3)))

    @property
    def transverse_fraction(self) -> Array:
        """Fraction of the kinetic energy that is displacement perpendicular to q, (s, p, b), 0 to
        1; for a lattice in the plane, only that within the plane.

        The rotational, longitudinal, transverse and out-of-plane fractions add up to 1.
        """
        transverse = 1.0 - self.rotational_fraction - self.longitudinal_fraction
        return np.asarray(np.clip(transverse - self.out_of_plane_fraction, 0.0, 1.0))

    @cached_property
    def edge_weight(self) -> Array:
        """Fractions of the kinetic energy in the outer quarters of a cut, at its lower and at its
        upper edge, (s, p, b, 2), 0 to 1.

        Where branches coincide, the fractions are those of the combinations of their modes that are
        most at one edge. Raises :class:`~granphon.base.errors.InputError` for a lattice that is not
        a cut: it repeats in space, or its balls are all at one height; and without eigenvectors.
        """
        n_periods = sum(self.pbc)  # those of a cut are along the first axes
        heights = (self.positions @ self.cell)[:, min(n_periods, 2)]
        has_heights = np.ptp(heights) > _LEAST_HEIGHT * float(np.abs(self.cell).max())
        if n_periods == 3 or not has_heights:
            raise InputError(
                "the lattice has no edges", mend="Take bands of network.cut(axis, layers)"
            )
        masks = find_outer(heights)  # (2, n)
        energy = np.abs(self.motion) ** 2
        # at each edge e the sum over its balls i and their motions c
        weights = np.einsum("ei,spicb->spbe", masks.astype(float), energy, optimize=True)
        is_degenerate = np.diff(self.frequencies, axis=2) <= _DEGENERACY * self.frequencies.max()
        for s, p in np.argwhere(np.any(is_degenerate, axis=2)):
            set_ends = np.flatnonzero(~is_degenerate[s, p]) + 1
            for branches in np.split(np.arange(self.n_branches), set_ends):
                if len(branches) > 1:
                    motion = self.motion[s, p][..., branches]
                    weights[s, p, branches] = _separate_edges(motion, masks)
        return read_only(np.clip(weights, 0.0, 1.0))

    @cached_property
    def connection(self) -> NDArray[np.intp]:
        """Index of each connected branch among the frequencies at each point, (s, p, b).

        ``np.take_along_axis(frequencies, connection, 2)`` follows the branches through their
        crossings. Branches are connected inside each segment, by the overlap of eigenvectors, and
        numbered by their order at its start.
        """
        # `motion` is these eigenvectors, and says how to ask for them where there are none
        segments = self.motion.reshape(*self.motion.shape[:2], -1, self.n_branches)
        return read_only([connect_branches(motions) for motions in segments])

    @property
    def connected_frequencies(self) -> Array:
        """Frequencies with each branch followed through its crossings, (s, p, b), Hz."""
        return np.take_along_axis(self.frequencies, self.connection, 2)

    # -- phonopy's band.yaml -----------------------------------------------------------------------

    def write(
        self,
        path: str | os.PathLike[str],
        pad: bool = False,
        errors: ArrayLike | None = None,
    ) -> None:
        """Write a band.yaml of phonopy to the file ``path``, with eigenvectors and group velocities
        if there are any, for phonopy-bandplot and Euphonic.

        Frequencies are in Hz, kHz, MHz or another such unit, in which the top frequency lies
        between 1 and 1000; the file names the unit. Coordinates of an atom that hold no motion are
        zero, such as w in the plane without friction. Some programs expect three branches for each
        atom. For these, ``pad`` adds one branch of zero frequency for each such coordinate, below
        the other branches, in which that coordinate alone moves. :meth:`read` leaves these branches
        out. With ``errors``, Hz, of the shape of ``frequencies``, each frequency is followed by its
        standard error, ``frequency_error``, which other programs and :meth:`read` pass over.

        A ball of six motions is two atoms. The second, "Sn", stands a little beside its ball. As
        in phonopy, its eigenvector has the phase at its own position; :meth:`read` restores the
        phase at the ball.

        A file that granphon wrote is replaced; if another file is there, such as one that phonopy
        wrote, :class:`~granphon.base.errors.FileExistsInRunError` is raised. Errors of another
        shape or below zero, a ``pad`` that is not true or false, and what is no path raise
        :class:`~granphon.base.errors.InputError`. Where the file system refuses the file,
        :class:`~granphon.base.errors.OutputError` is raised.
        """
        unit = HertzPrefix.for_top(float(self.frequencies.max()))
        n_still = 0
        if require("pad", truth, pad):
            n_still = len(self.masses) * len(self.motions.still_slots)
        lines = [
            *self._write_head(unit, n_still),
            "points:",
            *self._write_atoms(),
            "phonon:",
            *self._write_modes(unit, n_still, errors),
        ]
        write_text(path, seal(lines))

    def _write_head(self, unit: HertzPrefix, n_still: int) -> list[str]:
        """Return the lines of a band.yaml before those of its atoms.

        ``unit`` is that of the frequencies, and ``n_still`` the number of branches of coordinates
        that hold no motion.
        """
        s, p, _ = self.frequencies.shape
        lines = make_header(unit, self.scales, self.motions, self.periods)
        if n_still:
            lines.append(f"  still_branches: {n_still}")
        if not all(self.pbc):
            lines.append(f"  pbc: {json.dumps(self.pbc)}")
        lines += write_kinds(self.kinds)
        if np.any(self.gyration != GYRATION):
            entries = ", ".join(["%r"] * len(self.gyration))
            lines += fill_floats(f"  gyration: [ {entries} ]", [self.gyration.tolist()])
        lines += [
            f"  warnings: {json.dumps(self.warnings)}",
            f"frequency_unit: {unit.name}",
            "calculator: granphon",
            f"nqpoint: {s * p}",
            f"npath: {s}",
            "segment_nqpoint:",
        ]
        lines += [f"- {p}"] * s
        lines.append("labels:")
        lines += [f"- {json.dumps(ends)}" for ends in self._segment_ends]
        lines.append("reciprocal_lattice:")
        lines += fill_floats("- [ %r, %r, %r ]", np.linalg.inv(self.cell).T.tolist())
        lines.append(f"natom: {len(self.masses) * self.motions.atoms_per_ball}")
        lines.append("lattice:")
        lines += fill_floats("- [ %r, %r, %r ]", self.cell.tolist())
        return lines

    @property
    def _segment_ends(self) -> list[list[str]]:
        """The names of the first and of the last point of each segment. The label "K|M" of a jump
        names the last point K of one segment and the first point M of the next.
        """
        corners = [label.split("|") for label in self.labels]
        return [[start[-1], end[0]] for start, end in itertools.pairwise(corners)]

    def _write_atoms(self) -> list[str]:
        """Return the lines of a band.yaml on its atoms."""
        names = name_atoms(self.masses, self.motions, self.kinds)
        offset = OFFSET @ np.linalg.inv(self.cell)
        positions = place_atoms(self.positions, self.motions, offset)
        masses = np.repeat(self.masses, self.motions.atoms_per_ball)
        rows = np.column_stack([positions, masses]).tolist()
        texts = fill_floats("  coordinates: [ %r, %r, %r ]\n  mass: %r", rows)
        return [f"- symbol: {name}\n{lines}" for name, lines in zip(names, texts, strict=True)]

    def _write_modes(self, unit: HertzPrefix, n_still: int, errors: ArrayLike | None) -> list[str]:
        """Return the lines of a band.yaml on its wave vectors and modes, as one text for each wave
        vector.

        ``unit`` is that of the frequencies, and ``n_still`` the number of branches of coordinates
        that hold no motion, below the others; ``errors`` are the standard errors of the
        frequencies, Hz, None without.
        """
        _, p, b = self.frequencies.shape
        template, numbers = self._tabulate_modes(unit, n_still, errors)
        # the text of a wave vector is a template with %r for each number, which is filled below
        modes = "".join(f"  - # {number}\n{template}" for number in range(1, n_still + b + 1))
        points = np.column_stack([self.qpoints.reshape(-1, 3), self.distances.ravel()])
        heads = fill_floats("- q-position: [ %r, %r, %r ]\n  distance: %r\n", points.tolist())
        labels = list[str]()
        for ends in self._segment_ends:
            first, last = [f"  label: {json.dumps(name)}\n" for name in ends]
            labels += [first, *[""] * (p - 2), last][:p]
        bands = fill_floats(modes.removesuffix("\n"), map(np.ndarray.tolist, numbers))
        bands = [text.replace(" nan\n", " .nan\n") for text in bands]  # as YAML has it
        texts_of_points = zip(heads, labels, bands, strict=True)
        return [f"{head}{label}  band:\n{branches}" for head, label, branches in texts_of_points]

    def _tabulate_modes(
        self, unit: HertzPrefix, n_still: int, errors: ArrayLike | None
    ) -> tuple[str, Array]:
        """Return the lines of a mode in a band.yaml, a template with %r for each of m numbers, and
        the numbers of all modes, (s p, (n_still + b) m), a row for each wave vector.

        The arguments are those of :meth:`_write_modes`.
        """
        s, p, b = self.frequencies.shape
        template = "    frequency: %r\n"
        in_front = ((0, 0), (0, 0), (n_still, 0))
        frequencies = np.pad(self.frequencies, in_front) / unit.hertz
        columns = [frequencies[..., None]]  # each (s, p, n_still + b, some of the m numbers)
        if errors is not None:
            template += "    frequency_error: %r\n"
            errors_of_modes = read_errors("errors", errors, (s, p, b))
            columns.append(np.pad(errors_of_modes, in_front)[..., None] / unit.hertz)
        if self.group_velocities is not None:
            template += "    group_velocity: [ %r, %r, %r ]\n"
            widths = ((0, 0), (0, 0), (n_still, 0), (0, 3 - self.periods))
            velocities = np.pad(self.group_velocities, widths)
            columns.append(velocities / (self.scales.length * unit.hertz))
        if self.eigenvectors is not None:
            template += "    eigenvector:\n"
            components = self._list_components(n_still)
            template += ("    -\n" + "      - [ %r, %r ]\n" * 3) * components.shape[3]
            columns.append(components.reshape(s, p, n_still + b, -1))
        return template, np.concatenate(columns, axis=3).reshape(s * p, -1)

    def _list_components(self, n_still: int) -> Array:
        """Return real and imaginary parts of the eigenvectors, (s, p, n_still + b, atoms, 3, 2), in
        phonopy's coordinates. In each of the first ``n_still`` branches only one coordinate moves,
        one that holds no motion.
        """
        s, p, b = self.frequencies.shape
        n = len(self.masses)
        per_ball = self.motions.atoms_per_ball
        motion = np.zeros((s, p, n_still + b, n, 3 * per_ball), complex)
        motion[:, :, n_still:, :, list(self.motions.slots)] = np.moveaxis(self.motion, 4, 2)
        if n_still:
            units = np.eye(n_still).reshape(n_still, n, -1)
            motion[:, :, :n_still, :, list(self.motions.still_slots)] = units
        # the second atom of a ball has the phase at its own position
        phases = find_offset_phases(self.qpoints, self.cell).conj()
        motion[..., 3:] *= phases[:, :, None, None, None]
        return motion.view(float).reshape(s, p, n_still + b, n * per_ball, 3, 2)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Bands:
        """Return the bands of the file ``path``, a band.yaml that granphon wrote.

        Raises :class:`~granphon.base.errors.InputError` if the file is no band.yaml of granphon, if
        its digest is not that of its text, or if its numbers do not fit together;
        :class:`~granphon.base.errors.SchemaError`, an InputError too, for another schema; and
        :class:`~granphon.base.errors.MissingFileError` if there is no such file. Warns with
        :class:`~granphon.base.errors.UnverifiedFileWarning` if the file has no digest, as where
        another program has read a band.yaml of granphon and written it again: a change is then
        noticed only where numbers no longer fit together.
        """
        text, is_verified = read_sealed(path)
        with require_own_file(path, "band.yaml"):
            data = plain_yaml(text, path)
            hertz, scales = read_header(path, data["granphon"])
            bands = cls._of_data(data, hertz, scales)
            bands._check()
            reciprocal = read_numbers("reciprocal_lattice", data["reciprocal_lattice"])
            if not np.allclose(reciprocal, np.linalg.inv(bands.cell).T):
                raise InputError("Its reciprocal_lattice is not that of its lattice")
        if not is_verified:
            warn_unverified(path)
        return bands

    @classmethod
    def _of_data(cls, data: Any, hertz: float, scales: Units) -> Bands:
        """Return bands from the ``data`` of a band.yaml, with the unit ``hertz`` of its
        frequencies, Hz, and its ``scales``.

        Raises :class:`~granphon.base.errors.InputError` for data that do not fit together.
        """
        header = data["granphon"]
        phonon = data["phonon"]
        s, p = _read_counts(data)
        n_still = int(header.get("still_branches", 0))
        modes = [point["band"][n_still:] for point in phonon]
        b = len(modes[0])
        balls = _Balls.of_data(data, b)
        n = len(balls.masses)
        periods = balls.periods
        cell = read_numbers("lattice", data["lattice"])
        qpoints = read_numbers("q-position", [point["q-position"] for point in phonon])
        qpoints = qpoints.reshape(s, p, 3)
        distances = read_numbers("distance", [point["distance"] for point in phonon])
        frequencies = _read_mode_values("frequency", modes) * hertz
        eigenvectors = None
        if "eigenvector" in modes[0][0]:
            shape = (s, p, b, n, 3 * balls.motions.atoms_per_ball, 2)
            components = _read_mode_values("eigenvector", modes).reshape(shape)
            eigenvectors = _read_vectors(components, balls.motions, qpoints, cell)
        velocities = None
        if "group_velocity" in modes[0][0]:
            reduced = _read_velocities(modes, periods).reshape(s, p, b, periods)
            velocities = reduced * scales.length * hertz
        gyration = None
        if "gyration" in header:
            gyration = read_numbers("gyration", header["gyration"], (n,))
        return cls(
            qpoints=qpoints,
            distances=distances.reshape(s, p),
            frequencies=frequencies.reshape(s, p, b),
            group_velocities=velocities,
            eigenvectors=eigenvectors,
            labels=_join_labels(data["labels"]),
            cell=cell,
            positions=balls.positions,
            masses=balls.masses,
            scales=scales,
            warnings=tuple(header["warnings"]),
            motions=balls.motions,
            pbc=tuple(header.get("pbc", (True,) * periods)),
            kinds=balls.kinds,
            gyration=gyration,
        )


@result_class
class ComplexBands(Result, array="wavenumbers"):
    """All waves across the layers of a crystal at given frequencies. ``np.asarray`` of an instance
    is its ``wavenumbers``.

    A wave changes by the factor exp(i k h) from layer to layer, and in time as exp(-2 pi i f t).
    The waves of the first half of a row run or decay towards higher layers, and those of the second
    half towards lower layers. In each half running waves come first; the others follow, the slowest
    decay first. The imaginary part of k is infinite for motions that reach no other layer at a
    frequency. The error of exp(i k h) is about 1e-15, so that of k h grows with the decay.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    wavenumbers : (n_f, 2 m) k, 1/m, complex; real parts from -pi/h to pi/h.
    running : (n_f,) number of waves that run towards higher layers.
    height : h, the height of a layer, m.
    warnings : one sentence if dashpots resist more than springs, as a damping is a time, and was
        perhaps meant as a loss factor; else empty.
    """

    frequencies: Array = held(float, "f", "Hz")
    wavenumbers: Complex = held(complex, "f k", "1/m")
    running: Index = held(int, "f")
    height: float = held(float, unit="m")
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def forward(self) -> NDArray[np.complex128]:
        """(n_f, m) wavenumbers, 1/m, of the waves that run or decay towards higher layers."""
        return self.wavenumbers[:, : self.wavenumbers.shape[1] // 2]

    @property
    def attenuation(self) -> Array:
        """(n_f,) decay, dB from layer to layer, of the wave that decays the slowest; zero at
        frequencies in a band without losses.
        """
        return np.asarray(
            20.0 * math.log10(math.e) * self.height * np.min(self.forward.imag, axis=1)
        )


@result_class
class Onset(Result, array="frequencies"):
    """How the branches of a lattice begin at Gamma. ``np.asarray`` of an instance is its
    ``frequencies``.

    Attributes
    ----------
    frequencies : (n_branches,) frequencies at Gamma, Hz, ascending; zero for sound.
    curvatures : (n_branches,) d^2 omega/dq^2 beside Gamma, m^2/s.
    direction : (p,) unit vector along which the curvatures are.
    gap : the lowest frequency of all branches in the whole zone, Hz, below which no wave runs; zero
        if nothing holds the balls.
    """

    frequencies: Array = held(float, "b", "Hz")
    curvatures: Array = held(float, "b", "m^2/s")
    direction: Array = held(float, "p")
    gap: float = held(float, unit="Hz")


def _require(holds: Any, fault: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a ``fault`` of bands unless ``holds``."""
    if not holds:
        raise InputError(fault, mend="Make the bands again")


def _separate_edges(motion: NDArray[Any], masks: NDArray[np.bool_]) -> Array:
    """Return the fractions (b, 2) of the kinetic energy in the balls of the two ``masks`` (2, n),
    for those combinations of b coinciding modes that are most at one edge.

    ``motion`` (n, motions, b) are the modes; a mask is true for the balls at an edge.
    """
    energy_forms = []
    for mask in masks:
        outer = motion[mask]
        # products of two modes b and d, summed over the balls i at the edge and their motions c
        energy_forms.append(np.einsum("icb,icd->bd", outer.conj(), outer))
    low, high = energy_forms
    # the eigenvectors of the difference are the combinations that are most at one edge
    _, turn = np.linalg.eigh(high - low)
    weights = [np.einsum("ba,bc,ca->a", turn.conj(), form, turn).real for form in energy_forms]
    return np.stack(weights, axis=1)


class _Balls(NamedTuple):
    """The balls of a band.yaml.

    Attributes
    ----------
    motions : the motions of each ball.
    periods : number of periods of the lattice.
    positions : (n, 3) positions of the balls, fractions of the cell.
    masses : (n,) masses of the balls, in reduced units.
    kinds : (n,) names of the kinds of the balls; empty if they are not known.
    """

    motions: Motions
    periods: int
    positions: Array
    masses: Array
    kinds: tuple[str, ...]

    @classmethod
    def of_data(cls, data: Any, n_branches: int) -> Self:
        """Return the balls in the ``data`` of a band.yaml with a number of branches,
        ``n_branches``, one for each motion of each ball.

        Raises :class:`~granphon.base.errors.InputError` for atoms that are not those of balls, and
        for motions that do not fit the number of branches.
        """
        header = data["granphon"]
        atoms = data["points"]
        # a ball of six motions is two atoms, of which the first is at the position of the ball
        per_ball = read_motions(header)[0].atoms_per_ball
        if not atoms or len(atoms) % per_ball:
            raise InputError(f"Its {len(atoms)} atoms are no whole number of balls")
        motions, periods = read_motions(header, n_branches // (len(atoms) // per_ball))
        positions = read_numbers("coordinates", [atom["coordinates"] for atom in atoms])
        masses = read_numbers("mass", [atom["mass"] for atom in atoms])
        symbols = [atom["symbol"] for atom in atoms]
        kinds = read_kinds(header, symbols[::per_ball])
        if name_atoms(masses[::per_ball], motions, kinds) != symbols:
            raise InputError("Its atoms are not those of balls with these motions")
        return cls(motions, periods, positions[::per_ball], masses[::per_ball], kinds)


def _read_vectors(components: Array, motions: Motions, qpoints: Array, cell: Array) -> Complex:
    """Return the eigenvectors (s, p, n_dof, b) of balls with these ``motions``.

    ``components`` (s, p, b, n, 3 or 6, 2) are the real and imaginary parts of the coordinates of
    the one or two atoms of each ball in a band.yaml, at ``qpoints`` (s, p, 3) of the ``cell``
    (3, 3).
    """
    motion = components[..., 0] + 1j * components[..., 1]
    # the second atom of a ball gets the phase at the ball instead of that at its own position
    motion[..., 3:] *= find_offset_phases(qpoints, cell)[:, :, None, None, None]
    by_branch = motion[..., list(motions.slots)].reshape(*motion.shape[:3], -1)
    return np.moveaxis(by_branch, 2, 3)


def _read_velocities(modes: list[Any], periods: int) -> Array:
    """Return the group velocities (n_q, b, periods), d times the unit of frequencies, of the
    ``modes`` of a band.yaml, b for each of n_q wave vectors.

    Raises :class:`~granphon.base.errors.InputError` for a velocity across the ``periods``.
    """
    in_space = _read_mode_values("group_velocity", modes)
    if np.any(in_space[..., periods:]):
        raise InputError(f"It has a group_velocity across its {counted(periods, 'period')}")
    return in_space[..., :periods]


def _read_counts(data: Any) -> tuple[int, int]:
    """Return the numbers of segments and of points in a segment from the ``data`` of a band.yaml.

    Raises :class:`~granphon.base.errors.InputError` for numbers that do not fit the rest of the
    file.
    """
    counts = {}
    for key in ("npath", "nqpoint", "natom"):
        counts[key] = require(key, partial(whole, low=1), data[key])
    s = counts["npath"]
    count = counts["nqpoint"]
    n_listed = len(data["phonon"])
    p = n_listed // s
    are_points = count == n_listed == s * p and p > 0
    are_segments = data["segment_nqpoint"] == [p] * s and len(data["labels"]) == s
    if not (are_points and are_segments):
        raise InputError(
            f"Its keys npath ({s}), nqpoint ({count}), segment_nqpoint and labels do not fit the"
            f" {n_listed} points of phonon"
        )
    n_atoms = len(data["points"])
    if counts["natom"] != n_atoms:
        raise InputError(f"Its key natom is {data['natom']}, and it has {n_atoms} points")
    return s, p


def _read_mode_values(name: str, modes: list[Any]) -> Array:
    """Return the values (n_q, b, ...) of the key ``name`` in the ``modes`` of a band.yaml, b for
    each of n_q wave vectors.
    """
    return read_numbers(name, [[mode[name] for mode in branches] for branches in modes])


def _join_labels(listed: list[Any]) -> tuple[str, ...]:
    """Return the names of the corners (s + 1), "K|M" for a jump of the path, from those of the two
    ends of each of s segments, as a band.yaml has ``listed`` them.
    """
    ends = [[str(name) for name in names] for names in listed]
    labels = [ends[0][0]]
    for segment, following in itertools.pairwise(ends):
        is_jump = following[0] != segment[1]
        labels.append(f"{segment[1]}|{following[0]}" if is_jump else segment[1])
    labels.append(ends[-1][1])
    return tuple(labels)
