"""The compatibility matrix: the deformations of all contacts from the motions of all balls.

Every quantity of the lattice follows from it. A contact of normal n and tangent t = z x n deforms by

    elongation  e = (u_j - u_i).n
    slip        s = (u_j - u_i).t - (arm_i phi_i + arm_j phi_j)

These rows are C. With K the stiffnesses and M the masses, D(q) = M^-1/2 C(q)^H K C(q) M^-1/2. All of it is in reduced
units: length d, stiffness k, mass M. A ball's rotation is carried by w = R_g phi, R_g = (I/M)^1/2, so that its mass is the
ball's own.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_table import ContactTable
from granphon.base.arguments import not_negative, real_array
from granphon.base.errors import InputError, message
from granphon.base.results import read_only

__all__ = ["GYRATION", "Compatibility", "in_plane"]

Array = NDArray[np.float64]
#: radius of gyration of a ball about a diameter, (I/M)^1/2 = d/sqrt(10) (equation 8)
GYRATION = float(1.0 / np.sqrt(10.0))
#: relative difference of vectors that are equal but for rounding
_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)


def in_plane(wavevectors: ArrayLike) -> Array:
    """Wave vectors as (n_q, 2), from (..., 2); :class:`~granphon.base.errors.InputError` if they are not."""
    q = real_array("wavevectors", wavevectors)
    if q.shape[-1:] != (2,):
        raise InputError(message(f"wave vectors of shape {q.shape}", mend="Give (n_q, 2)"))
    return q.reshape(-1, 2)


class Compatibility:
    """Balls in contact on a periodic lattice, in reduced units: C(q) and D(q).

    Parameters
    ----------
    cell : (2, 2) lattice vectors as rows.
    positions : (n, 2) centres.
    contacts : the table of contacts, in the same unit of length.
    mindlin_ratio : eta; at zero there is neither slip nor rotation.
    stiffness : (n_c,) normal stiffness of each contact; 1 by default.
    prestress : (n_c,) compressive force over spacing of each contact; 0 by default, which is the paper's limit.
    masses : (n,) masses; 1 by default.
    gyration : (n,) radii of gyration; d/sqrt(10) by default.

    Raises
    ------
    InputError : shapes or values that cannot be.
    """

    def __init__(
        self,
        cell: ArrayLike,
        positions: ArrayLike,
        contacts: ContactTable,
        mindlin_ratio: float,
        stiffness: ArrayLike = 1.0,
        prestress: ArrayLike = 0.0,
        masses: ArrayLike = 1.0,
        gyration: ArrayLike = GYRATION,
    ) -> None:
        self.cell: Array = read_only(real_array("cell", cell))
        self.positions: Array = read_only(real_array("positions", positions))
        self.contacts = contacts
        self.mindlin_ratio = not_negative("mindlin_ratio", mindlin_ratio)
        self.stiffness: Array = read_only(np.broadcast_to(real_array("stiffness", stiffness), len(contacts)))
        self.prestress: Array = read_only(np.broadcast_to(real_array("prestress", prestress), len(contacts)))
        self.masses: Array = read_only(np.broadcast_to(real_array("masses", masses), self.n_balls))
        self.gyration: Array = read_only(np.broadcast_to(real_array("gyration", gyration), self.n_balls))
        if not (np.all(self.masses > 0.0) and np.all(self.stiffness > 0.0)):
            raise InputError(message("a mass or a contact stiffness is not above zero"))

    # -- sizes ------------------------------------------------------------------------------------------------------

    @property
    def n_balls(self) -> int:
        """Balls in the cell."""
        return len(self.positions)

    @property
    def rotates(self) -> bool:
        """Whether the balls have a rotational degree of freedom: only if a contact resists slip."""
        return self.mindlin_ratio > 0.0

    @property
    def dofs_per_ball(self) -> int:
        """3 with friction, 2 without."""
        return 3 if self.rotates else 2

    @property
    def n_branches(self) -> int:
        """Degrees of freedom in the cell."""
        return self.dofs_per_ball * self.n_balls

    @cached_property
    def area(self) -> float:
        """Area of the cell."""
        return float(abs(np.linalg.det(self.cell)))

    @cached_property
    def reciprocal(self) -> Array:
        """(2, 2): reciprocal vectors as rows, 2 pi included."""
        return read_only(2.0 * np.pi * np.linalg.inv(self.cell).T)

    @property
    def is_prestressed(self) -> bool:
        """Whether the static force itself enters the stiffness; K is then indefinite."""
        return bool(np.any(self.prestress != 0.0))

    def wavevectors(self, fractions: ArrayLike) -> Array:
        """Cartesian wave vectors (..., 2) of fractions (..., 2 or 3) of the reciprocal cell."""
        q = real_array("fractions", fractions)
        if q.shape[-1:] not in ((2,), (3,)):
            raise InputError(message(f"fractions of shape {q.shape}", mend="Give (..., 2) or (..., 3) of them"))
        return np.asarray(q[..., :2] @ self.reciprocal)

    # -- the compatibility matrix -----------------------------------------------------------------------------------

    @cached_property
    def _frame(self) -> Array:
        """(n, n) orthogonal: the first column is the motion of the centre of mass in mass-weighted coordinates.

        In this frame the long-wave motion is one column, of half-angle sines, instead of a difference of n.
        """
        weights = np.sqrt(self.masses / self.masses.sum())
        basis = np.eye(self.n_balls)
        basis[:, 0] = weights
        frame, _ = np.linalg.qr(basis)
        return np.asarray(frame * np.sign(frame[0, 0] * weights[0]))

    def compatibility(self, wavevectors: ArrayLike, derivative: bool = False) -> NDArray[Any]:
        """K^1/2 C(q) M^-1/2 at each wave vector.

        Rows are the elongations of all contacts, then their slips. Columns are the mass-weighted motions (x, y, w) in the
        frame whose first vector is the centre of mass, w divided by i. With one ball in the cell the matrix is real.

        Parameters
        ----------
        wavevectors : (n_q, 2), 1/d.
        derivative : the gradient with respect to q instead.

        Returns
        -------
        (n_q, n_rows, n_branches), or (n_q, 2, n_rows, n_branches) for the gradient.
        """
        rows = self._rows(wavevectors, derivative)
        if derivative:
            return np.asarray(rows[:, None] * self._half_vectors(rows).T[None, :, :, None])
        return rows

    def _half_vectors(self, rows: NDArray[Any]) -> Array:
        """(n_rows, 2): gradient of the half angle of each row's contact with respect to q."""
        return 0.5 * np.tile(self.contacts.vector, (rows.shape[1] // len(self.contacts), 1))

    def _rows(self, wavevectors: ArrayLike, derivative: bool = False, prestress: bool = False) -> NDArray[Any]:
        """Rows of C(q), or their derivative with respect to the half angle q.(r_j - r_i)/2 of the row's contact.

        With ``prestress``, the rows of transverse displacement times |f/a|^1/2 instead.
        """
        q = in_plane(wavevectors)
        table, n = self.contacts, self.n_balls
        half = 0.5 * (q @ table.vector.T)  # (n_q, n_c)
        sine, cosine = np.sin(half), np.cos(half)
        if derivative:
            sine, cosine = cosine, -sine
        dtype = np.float64 if n == 1 else np.complex128
        # A motion of the frame enters a contact as its difference (translations) and mean (rotations) over the two ends,
        # each divided by i. The difference of the centre of mass is 2 sin, and nothing is subtracted in it.
        motion = self._frame / np.sqrt(self.masses)[:, None]
        end_i, end_j = motion[table.i], motion[table.j]  # (n_c, n)
        gap = end_j - end_i
        gap[:, 0] = 0.0
        difference: NDArray[Any] = (sine[..., None] * (end_j + end_i)).astype(dtype)  # (n_q, n_c, n)
        if n > 1:
            difference = difference - 1j * cosine[..., None] * gap
        blocks: list[tuple[Array, Array, NDArray[Any] | None]] = []
        if prestress:
            blocks.append((np.sqrt(np.abs(self.prestress)), table.tangent, None))
        else:
            blocks.append((np.sqrt(self.stiffness), table.normal, None))
            if self.rotates:
                lever_i = (table.arm_i / self.gyration[table.i])[:, None] * end_i
                lever_j = (table.arm_j / self.gyration[table.j])[:, None] * end_j
                mean: NDArray[Any] = (cosine[..., None] * (lever_j + lever_i)).astype(dtype)
                if n > 1:
                    mean = mean + 1j * sine[..., None] * (lever_j - lever_i)
                blocks.append((np.sqrt(self.mindlin_ratio * self.stiffness), table.tangent, mean))
        rows = np.zeros((len(q), len(blocks), len(table), n, self.dofs_per_ball), dtype)
        for b, (root, axis, turning) in enumerate(blocks):
            rows[:, b, ..., :2] = root[:, None, None] * difference[..., None] * axis[:, None, :]
            if turning is not None:
                rows[:, b, ..., 2] = -root[:, None] * turning
        return rows.reshape(len(q), len(blocks) * len(table), self.n_branches)

    @cached_property
    def _images(self) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
        """Contacts and their images, if the lattice looks the same inverted about each of its balls; else None.

        The image of a contact is one of the same balls with the opposite vector. A contact of a ball with itself is its
        own, and is left out.
        """
        table = self.contacts
        # seen from the ball of the lower number: what an image shares, and what it has with the opposite sign
        turned = (table.i > table.j)[:, None]
        ends = np.sort(np.stack([table.i, table.j], axis=1), axis=1)
        arms = np.where(turned, np.stack([table.arm_j, table.arm_i], axis=1), np.stack([table.arm_i, table.arm_j], axis=1))
        same = np.column_stack([ends, arms, self.stiffness, self.prestress])
        opposite = np.where(turned, -1.0, 1.0) * np.column_stack([table.vector, table.normal])
        left, first, image = ends[:, 0] != ends[:, 1], [], []
        while np.any(left):
            c = int(np.argmax(left))
            left[c] = False
            inverted = np.all(np.abs(opposite + opposite[c]) <= _ROUNDING * np.max(np.abs(opposite[c])), axis=1)
            alike = np.all(np.abs(same - same[c]) <= _ROUNDING * np.abs(same[c]), axis=1)
            others = np.flatnonzero(left & inverted & alike)
            if not others.size:
                return None
            left[others[0]] = False
            first.append(c)
            image.append(int(others[0]))
        return np.array(first, np.intp), np.array(image, np.intp)

    @cached_property
    def _wave_contacts(self) -> NDArray[np.intp]:
        """(n_c,): to which contact each row of :meth:`_waves` belongs."""
        found = np.arange(len(self.contacts))
        if self._images is not None:
            first, image = self._images
            found[image] = first
        return found

    def _waves(self, wavevectors: ArrayLike, derivative: bool = False, prestress: bool = False) -> NDArray[Any]:
        """Rows with the same C^H C as those of :meth:`_rows`: real ones if each contact has an image.

        The row of an image is the complex conjugate: 2^1/2 times the real and the imaginary part of one replace both.
        """
        rows = self._rows(wavevectors, derivative, prestress)
        if self.n_balls == 1 or self._images is None:
            return rows
        first, image = self._images
        kinds = rows.reshape(len(rows), -1, len(self.contacts), self.n_branches)
        real = kinds.real.copy()
        real[:, :, image] = kinds.imag[:, :, first]
        paired = np.ones((len(self.contacts), 1))
        paired[[first, image]] = np.sqrt(2.0)
        return np.asarray((real * paired).reshape(rows.shape))

    def _wave_half_vectors(self, waves: NDArray[Any]) -> Array:
        """(n_rows, 2): gradient of the half angle of the contact of each row of :meth:`_waves`."""
        return 0.5 * np.tile(self.contacts.vector[self._wave_contacts], (waves.shape[1] // len(self.contacts), 1))

    def _frame_matrix(self, wavevectors: ArrayLike) -> NDArray[Any]:
        """D(q) in the frame, prestress included."""
        rows = self._waves(wavevectors)
        matrix = rows.conj().swapaxes(1, 2) @ rows
        if self.is_prestressed:
            across = self._waves(wavevectors, prestress=True)
            matrix = matrix - across.conj().swapaxes(1, 2) @ (np.sign(self.prestress[self._wave_contacts])[:, None] * across)
        return np.asarray(matrix)

    @cached_property
    def _to_balls(self) -> NDArray[np.complex128]:
        """(n_branches, n_branches): from the frame, with w divided by i, to the balls' own (x, y, w)."""
        return np.asarray(np.kron(self._frame, np.diag([1.0, 1.0, 1.0j][: self.dofs_per_ball])), complex)

    def dynamical_matrix(self, wavevectors: ArrayLike) -> NDArray[np.complex128]:
        """D(q) = M^-1/2 C^H K C M^-1/2, (n_q, n_branches, n_branches), Hermitian, in units of k/M.

        Dofs run (x, y, w) over the balls; phases are those of the balls' own places, as in phonopy. ``wavevectors``
        (n_q, 2) in 1/d.
        """
        return np.asarray(self._to_balls @ self._frame_matrix(wavevectors) @ self._to_balls.conj().T)
