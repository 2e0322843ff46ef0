"""Band structures, in memory and in phonopy's band.yaml; and complex ones, of waves that decay
too.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.layers import find_outer
from granphon.balls.motions import IN_PLANE, Motions
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError
from granphon.base.results import Result
from granphon.base.scales import HertzPrefix, Units, read_header
from granphon.base.staging import write_text
from granphon.base.text import (
    counted,
    plain_yaml,
    read_sealed,
    require_own_file,
    seal,
    warn_unverified,
    write_float,
)
from granphon.base.validation import require, whole
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

#: difference of frequencies, over the top one, at which branches coincide
_COINCIDE = 1e-6
#: share of the top frequency by which frequencies at one point may be out of order
_ROUNDING = 1e-6
#: highest frequency in units of the scales: that of a stiff contact, (k/M)^(1/2), is of order one
_HIGHEST = 1e3
#: largest deviation of the length of an eigenvector from one
_LENGTH_ERROR = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class PhononModes(Modes):
    """:class:`~granphon.dynamics.contact_lattice.Modes` in SI units: Hz, rad/m and m/s;
    eigenvectors are unchanged.
    """

    units = {"wavevectors": "rad/m", "frequencies": "Hz", "group_velocities": "m/s"}


@dataclass(frozen=True, eq=False, repr=False)
class Bands(Result):
    """A band structure: frequencies in Hz, group velocities in m/s and eigenvectors along a path of
    wave vectors.

    The axes of arrays are segments s, points p in a segment, and branches b. A corner where two
    segments join is in both, as in phonopy.

    Attributes
    ----------
    qpoints : (s, p, 3), wave vectors as fractions of the reciprocal cell.
    distances : (s, p), distance along the path over 2 pi, in units of 1/d, as in phonopy: a number
        without a unit.
    frequencies : (s, p, b), Hz, ascending.
    group_velocities : (s, p, b, d), m/s, along the d periods of the lattice; at Gamma, and where
        branches touch or vanish, the limit along the path. None of bands that were made without
        eigenvectors.
    eigenvectors : (s, p, n_dof, b), complex, mass-weighted, orthonormal; the motions of ball after
        ball, (x, y, w) in the plane; or None. Fractions and connections, which follow from them,
        then raise
        :class:`~granphon.base.errors.InputError`.
    labels : (s + 1), names of the corners.
    cell, positions, masses : the cell that the q points belong to, in reduced units: its vectors
        (3, 3), the positions of the balls (n, 3) as fractions of these vectors, and the masses
        (n,).
    scales : the length, stiffness and mass that convert reduced units to SI.
    warnings : one sentence for each limit of the model that the state exceeds, and for branches
        that cost no energy.
    motions : the motions of each ball; rotations that the eigenvectors do not have are left out.
    pbc : along which of the d periods of the lattice the cell repeats, by default all; a ribbon
        that is cut out of a lattice in the plane repeats along one.
    kinds : names of the kinds of the balls, if they are known.
    gyration : (n,) radii of gyration of the balls, in reduced units; by default of solid balls with
        the diameter 1.
    """

    qpoints: Annotated[Array, "s p 3"]
    distances: Annotated[Array, "s p", "1"]
    frequencies: Annotated[Array, "s p b", "Hz"]
    group_velocities: Annotated[Array | None, "s p b d?", "m/s"]
    eigenvectors: Annotated[Complex | None, "s p m b?"]
    labels: Annotated[tuple[str, ...], "s+1"]
    cell: Annotated[Array, "3 3"]
    positions: Annotated[Array, "n 3"]
    masses: Annotated[Array, "n"]
    scales: Units
    warnings: tuple[str, ...] = ()
    motions: Motions = IN_PLANE
    pbc: tuple[bool, ...] = ()
    kinds: tuple[str, ...] = ()
    gyration: Annotated[Any, "n"] = None  # an array from the constructor on

    def __post_init__(self) -> None:
        if self.gyration is None:
            object.__setattr__(self, "gyration", np.full(len(self.masses), GYRATION))
        super().__post_init__()
        if not self.pbc:
            object.__setattr__(self, "pbc", (True,) * self.periods)

    def _check(self) -> None:
        """Check shapes, and that all numbers are finite and can be those of bands."""
        super()._check()
        balls = len(self.masses)
        lengths = np.ones(1)
        p = self.periods
        if self.eigenvectors is not None:
            if self.eigenvectors.shape[2] != self.motions.count * balls:
                raise InputError(
                    f"{self.eigenvectors.shape[2]} components of an eigenvector for {balls} balls",
                    mend=f"Give {self.motions.count} for each ball",
                )
            lengths = np.linalg.norm(self.eigenvectors, axis=2)
        self._require_finite()
        leaves = (
            bool(np.any(self.qpoints[..., p:]))
            or bool(np.any(self.cell[:p, p:]))
            or bool(np.any(self.cell[p:, :p]))
        )
        # the lowest frequencies are roots of rounding errors, which may put neighbours out of order
        falls = -np.diff(self.frequencies, axis=2) > _ROUNDING * self.frequencies.max(initial=0.0)
        for holds, fault in (
            (self.frequencies.size > 0, "there is no frequency"),
            (
                not leaves,
                f"a wave vector or a lattice vector leaves the"
                f" {('line', 'plane', 'space')[p - 1]} of {p} periods",
            ),
            (np.all(self.frequencies >= 0.0), "a frequency is below zero"),
            (not np.any(falls), "the frequencies at a point do not ascend"),
            (
                np.all(self.frequencies <= _HIGHEST * self.scales.frequency),
                "a frequency is far above those of the scales",
            ),
            (
                np.all(np.diff(self.distances.ravel()) >= 0.0),
                "the distances along the path do not ascend",
            ),
            (np.all(self.masses > 0.0), "a mass is not above zero"),
            (np.all(self.gyration > 0.0), "a radius of gyration is not above zero"),
            (len(self.kinds) in (0, balls), "kinds are not those of all balls"),
            (abs(np.linalg.det(self.cell)) > 0.0, "the cell has no volume"),
            (
                np.all(np.abs(lengths - 1.0) <= _LENGTH_ERROR),
                "an eigenvector has not the length one",
            ),
            (
                len(self.pbc) == p and all(isinstance(repeats, bool) for repeats in self.pbc),
                f"pbc is not {p} times true or false",
            ),
        ):
            if not holds:
                raise InputError(fault, mend="Make the bands again")

    @property
    def n_branches(self) -> int:
        """Number of branches: one for each motion of each ball."""
        return int(self.frequencies.shape[2])

    @property
    def periods(self) -> int:
        """Number of periods of the lattice."""
        return (
            len(self.pbc) if self.group_velocities is None else int(self.group_velocities.shape[3])
        )

    @cached_property
    def motion(self) -> NDArray[Any]:
        """Eigenvectors with the balls on an axis of their own, (s, p, n_balls, components of a
        ball, b).

        Raises :class:`~granphon.base.errors.InputError` if there are none.
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
        return np.asarray(
            np.sum(np.abs(self.motion[:, :, :, self.motions.turning]) ** 2, axis=(2, 3))
        )

    @property
    def longitudinal_fraction(self) -> Array:
        """Fraction of the kinetic energy that is motion along q (at Gamma, along the path), (s, p,
        b), 0 to 1.
        """
        d = self.periods
        q = self.qpoints[..., :d] @ np.linalg.inv(self.cell[:d, :d]).T
        ahead = np.broadcast_to((q[:, -1] - q[:, 0])[:, None], q.shape)
        ahead = np.where(np.any(q != 0.0, axis=-1, keepdims=True), q, ahead)
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        axes = [axis for axis in self.motions.translations if axis < d]
        inside = [self.motions.translations.index(axis) for axis in axes]
        moved = self.motion[:, :, :, inside]
        along = np.einsum("spiab,spa->spib", moved, ahead[..., axes])
        return np.asarray(np.sum(np.abs(along) ** 2, axis=2))

    @property
    def out_of_plane_fraction(self) -> Array:
        """Fraction of the kinetic energy that is displacement out of a plane lattice, (s, p, b), 0
        to 1.

        It is zero for lattices with one or three periods.
        """
        across = [
            component
            for component, axis in enumerate(self.motions.translations)
            if axis >= self.periods == 2
        ]
        return np.asarray(np.sum(np.abs(self.motion[:, :, :, across]) ** 2, axis=(2, 3)))

    @property
    def transverse_fraction(self) -> Array:
        """Fraction of the kinetic energy that is displacement across q, (s, p, b), 0 to 1; of a
        plane lattice, in its plane.

        With the rotational, the longitudinal and the out-of-plane fraction it adds up to 1.
        """
        transverse = 1.0 - self.rotational_fraction - self.longitudinal_fraction
        return np.asarray(np.clip(transverse - self.out_of_plane_fraction, 0.0, 1.0))

    @cached_property
    def edge_weight(self) -> Array:
        """Fraction of the kinetic energy in the outer quarter of a cut, lower and upper edge, (s,
        p, b, 2), 0 to 1.

        Where branches coincide, the modes are taken that are most at one edge. Raises
        :class:`~granphon.base.errors.InputError` of a lattice that is not a cut: all balls are at
        one height.
        """
        heights = (self.positions @ self.cell)[:, min(sum(self.pbc), 2)]
        if not np.ptp(heights) > 1e-9 * float(np.abs(self.cell).max()):
            raise InputError(
                "the lattice has no edges", mend="Take bands of network.cut(axis, layers)"
            )
        masks = find_outer(heights)
        energy = np.abs(self.motion) ** 2
        weights = np.einsum("ei,spicb->spbe", masks.astype(float), energy, optimize=True)
        close = np.diff(self.frequencies, axis=2) <= _COINCIDE * self.frequencies.max()
        for s, p in np.argwhere(np.any(close, axis=2)):
            for group in np.split(np.arange(self.n_branches), np.flatnonzero(~close[s, p]) + 1):
                if len(group) == 1:
                    continue
                motion = self.motion[s, p][..., group]
                low, high = (
                    np.einsum("icb,icd->bd", motion[mask].conj(), motion[mask]) for mask in masks
                )
                turned = np.linalg.eigh(high - low)[1]
                for edge, form in enumerate((low, high)):
                    parts = np.einsum("ba,bc,ca->a", turned.conj(), form, turned)
                    weights[s, p, group, edge] = parts.real
        return np.asarray(np.clip(weights, 0.0, 1.0))

    @cached_property
    def connection(self) -> NDArray[np.intp]:
        """Index of each connected branch among the frequencies at each point, (s, p, b).

        ``np.take_along_axis(frequencies, connection, 2)`` follows the branches through their
        crossings. Branches are connected inside each segment, by the overlap of eigenvectors, and
        numbered by their order at its start.
        """
        segments = self.motion.reshape(*self.motion.shape[:2], -1, self.n_branches)
        return np.array([connect_branches(motions) for motions in segments])

    @property
    def connected_frequencies(self) -> Array:
        """Frequencies with each branch followed through its crossings, (s, p, b), Hz."""
        return np.take_along_axis(self.frequencies, self.connection, 2)

    # -- phonopy's band.yaml -----------------------------------------------------------------------

    def write(self, path: str | os.PathLike[str], pad: bool = False) -> None:
        """Write phonopy's band.yaml, with eigenvectors and group velocities if there are, for
        phonopy-bandplot and Euphonic.

        Frequencies are in Hz, kHz, MHz or another such unit, in which the top one lies between 1
        and 1000; the file names the unit. Coordinates of an atom that hold no motion are zero, such
        as w in the plane without friction. Some programs expect three branches for each atom:
        ``pad`` adds, below the others, one branch at zero frequency for each such coordinate, which
        moves it alone. :meth:`read` leaves these branches out.

        A ball of six motions is two atoms. The second, "Sn", stands a little aside of its ball. As
        in phonopy, its eigenvector has the phase at that place; :meth:`read` restores the phase at
        the ball.

        A file of granphon is replaced; if another is there, as one of phonopy's own,
        :class:`~granphon.base.errors.FileExistsInRunError` is raised.
        """
        top = float(self.frequencies.max())
        unit = HertzPrefix.for_top(top)
        s, p, b = self.frequencies.shape
        n = len(self.masses)
        per_ball = self.motions.atoms_per_ball
        slots = list(self.motions.slots)
        still_slots = list(self.motions.still_slots)
        still = n * len(still_slots) if pad else 0
        frequencies = np.pad(self.frequencies, ((0, 0), (0, 0), (still, 0)))
        velocities = None
        parts = None
        if self.group_velocities is not None:
            velocities = np.pad(
                self.group_velocities, ((0, 0), (0, 0), (still, 0), (0, 3 - self.periods))
            )
            velocities /= self.scales.length * unit.hertz
        if self.eigenvectors is not None:
            motion = np.zeros((s, p, n, 3 * per_ball, still + b), complex)
            motion[:, :, :, slots, still:] = self.motion
            if still:
                motion[:, :, :, still_slots, :still] = np.eye(still).reshape(n, -1, still)
            # what an atom aside of its ball lacks of the phase of the ball
            motion[:, :, :, 3:] *= find_offset_phases(self.qpoints, self.cell).conj()[
                :, :, None, None, None
            ]
            motion = motion.reshape(s, p, n * per_ball, 3, still + b)
            parts = np.stack([motion.real, motion.imag], axis=-1)
        ticks = [tick.split("|") for tick in self.labels]
        lines = [
            *make_header(unit, self.scales, self.motions, self.periods),
            *([f"  still_branches: {still}"] if still else []),
            *([] if all(self.pbc) else [f"  pbc: {json.dumps(self.pbc)}"]),
            *write_kinds(self.kinds),
            *(
                [f"  gyration: {_write_row(self.gyration.tolist())}"]
                if np.any(self.gyration != GYRATION)
                else []
            ),
            f"  warnings: {json.dumps(self.warnings)}",
            f"frequency_unit: {unit.name}",
            "calculator: granphon",
            f"nqpoint: {s * p}",
            f"npath: {s}",
            "segment_nqpoint:",
            *[f"- {p}"] * s,
            "labels:",
            *(f"- {json.dumps([a[-1], z[0]])}" for a, z in itertools.pairwise(ticks)),
            "reciprocal_lattice:",
            *(f"- {_write_row(row)}" for row in np.linalg.inv(self.cell).T.tolist()),
            f"natom: {n * per_ball}",
            "lattice:",
            *(f"- {_write_row(row)}" for row in self.cell.tolist()),
            "points:",
        ]
        positions = place_atoms(self.positions, self.motions, OFFSET @ np.linalg.inv(self.cell))
        masses = np.repeat(self.masses, per_ball).tolist()
        for name, position, mass in zip(
            name_atoms(self.masses, self.motions, self.kinds), positions, masses, strict=True
        ):
            lines += [
                f"- symbol: {name}",
                f"  coordinates: {_write_row(position.tolist())}",
                f"  mass: {write_float(mass)}",
            ]
        lines.append("phonon:")
        hertz = frequencies / unit.hertz
        for i, j in np.ndindex(s, p):
            lines += [f"- q-position: {_write_row(self.qpoints[i, j].tolist())}"]
            lines += [f"  distance: {write_float(float(self.distances[i, j]))}"]
            if j in (0, p - 1):
                lines.append(f"  label: {json.dumps(ticks[i][-1] if j == 0 else ticks[i + 1][0])}")
            lines.append("  band:")
            for k in range(still + b):
                lines += [f"  - # {k + 1}", f"    frequency: {write_float(float(hertz[i, j, k]))}"]
                if velocities is not None:
                    lines.append(f"    group_velocity: {_write_row(velocities[i, j, k].tolist())}")
                lines += ["    eigenvector:"] * (parts is not None)
                for atom in () if parts is None else parts[i, j, :, :, k].tolist():
                    lines += ["    -", *(f"      - {_write_row(pair)}" for pair in atom)]
        write_text(path, seal(lines))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Bands:
        """Read a band.yaml that granphon wrote.

        Raises :class:`~granphon.base.errors.InputError` if another program wrote the file, or it is
        damaged or was edited; :class:`~granphon.base.errors.MissingFileError` if there is no such
        file. Warns with :class:`~granphon.base.errors.UnverifiedFileWarning` if it carries no
        digest, as a copy by another program.
        """
        text, verified = read_sealed(path)
        with require_own_file(path, "band.yaml"):
            data = plain_yaml(text, path)
            header = data["granphon"]
            phonon = data["phonon"]
            hertz, scales = read_header(path, header)
            s, count, natom = (
                require(key, partial(whole, low=1), data[key])
                for key in ("npath", "nqpoint", "natom")
            )
            p = len(phonon) // s
            fits = count == len(phonon) == s * p and p > 0
            if not fits or data["segment_nqpoint"] != [p] * s or len(data["labels"]) != s:
                raise InputError(
                    f"Its keys npath ({s}), nqpoint ({count}), segment_nqpoint and labels do not"
                    f" fit the {len(phonon)} points of phonon"
                )
            points = data["points"]
            if natom != len(points):
                raise InputError(
                    f"Its key natom is {data['natom']}, and it has {len(points)} points"
                )
            symbols = [point["symbol"] for point in points]
            n = natom // read_motions(header)[0].atoms_per_ball
            still = int(header.get("still_branches", 0))
            bands = [q["band"][still:] for q in phonon]
            b = len(bands[0])
            per_ball = len(points) // max(n, 1)
            motions, periods = read_motions(header, b // max(n, 1))
            cell = read_numbers("lattice", data["lattice"])
            qpoints = read_numbers("q-position", [q["q-position"] for q in phonon]).reshape(s, p, 3)
            vectors = None
            velocities = None
            if "eigenvector" in bands[0][0]:
                parts = read_numbers(
                    "eigenvector", [[mode["eigenvector"] for mode in q] for q in bands]
                )
                moved = (parts[..., 0] + 1j * parts[..., 1]).reshape(s, p, b, n, 3 * per_ball)
                moved[..., 3:] *= find_offset_phases(qpoints, cell)[:, :, None, None, None]
                vectors = np.moveaxis(moved[..., list(motions.slots)].reshape(s, p, b, -1), 2, 3)
            if "group_velocity" in bands[0][0]:
                travel = read_numbers(
                    "group_velocity", [[mode["group_velocity"] for mode in q] for q in bands]
                )
                if np.any(travel[..., periods:]):
                    raise InputError(
                        f"It has a group_velocity across its {counted(periods, 'period')}"
                    )
                velocities = travel[..., :periods].reshape(s, p, b, periods) * scales.length * hertz
            pairs = [[str(x) for x in pair] for pair in data["labels"]]
            labels = [pairs[0][0]]
            for pair, following in zip(pairs, [*pairs[1:], None], strict=True):
                jump = following is not None and following[0] != pair[1]
                labels.append(f"{pair[1]}|{following[0]}" if jump and following else pair[1])
            coordinates = read_numbers("coordinates", [point["coordinates"] for point in points])
            masses = read_numbers("mass", [point["mass"] for point in points])
            kinds = read_kinds(header, symbols[::per_ball])
            if name_atoms(masses[::per_ball], motions, kinds) != symbols:
                raise InputError("Its atoms are not those of balls with these motions")
            read_bands = cls(
                qpoints,
                read_numbers("distance", [q["distance"] for q in phonon]).reshape(s, p),
                read_numbers(
                    "frequency", [[mode["frequency"] for mode in q] for q in bands]
                ).reshape(s, p, b)
                * hertz,
                velocities,
                vectors,
                tuple(labels),
                cell,
                coordinates[::per_ball],
                masses[::per_ball],
                scales,
                tuple(header["warnings"]),
                motions,
                tuple(header.get("pbc", (True,) * periods)),
                kinds,
                read_numbers("gyration", header["gyration"], (n,))
                if "gyration" in header
                else None,
            )
            read_bands._check()
            if not np.allclose(
                read_numbers("reciprocal_lattice", data["reciprocal_lattice"]),
                np.linalg.inv(cell).T,
            ):
                raise InputError("Its reciprocal_lattice is not that of its lattice")
        if not verified:
            warn_unverified(path)
        return read_bands


@dataclass(frozen=True, eq=False, repr=False)
class ComplexBands(Result, array="wavenumbers"):
    """All waves across the layers of a crystal at given frequencies. ``np.asarray`` of it is
    ``wavenumbers``.

    A motion changes by exp(i k h) from layer to layer, in the time exp(-2 pi i f t). Waves of the
    first half of a row run or decay towards higher layers, waves of the second half towards lower
    layers. In each half running waves come first; the others follow, the slowest decay first. An
    imaginary part is infinite where a motion reaches no other layer at a frequency. The error of
    exp(i k h) is about 1e-15, so that of k h grows with the decay.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    wavenumbers : (n_f, 2 m) k, 1/m, complex; real parts from -pi/h to pi/h.
    running : (n_f,) number of waves that run towards higher layers.
    height : of a layer, h, m.
    warnings : one sentence where contacts are more viscous than stiff, as a damping is a time.
    """

    frequencies: Annotated[Array, "f", "Hz"]
    wavenumbers: Annotated[Complex, "f k", "1/m"]
    running: Annotated[Index, "f"]
    height: Annotated[float, "", "m"]
    warnings: tuple[str, ...] = ()

    @property
    def forward(self) -> NDArray[np.complex128]:
        """(n_f, m) the wave numbers of waves that run or decay towards higher layers, 1/m."""
        return self.wavenumbers[:, : self.wavenumbers.shape[1] // 2]

    @property
    def attenuation(self) -> Array:
        """(n_f,) decay of the wave that goes farthest, dB from layer to layer; zero in bands
        without losses.
        """
        return np.asarray(
            20.0 * math.log10(math.e) * self.height * np.min(self.forward.imag, axis=1)
        )


def _write_row(values: list[float]) -> str:
    """Write numbers with all their digits as a list of YAML."""
    # by hand, as PyYAML takes ten times the time for a file, and json writes 1e-06, a text to
    # phonopy and Euphonic
    return f"[ {', '.join(map(write_float, values))} ]"
