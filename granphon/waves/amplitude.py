"""The frequency of a wave over its amplitude, by perturbation to second order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.errors import InputError
from granphon.base.validation import real_array, whole_number
from granphon.dynamics.compatibility import require_digits
from granphon.waves.contact_forces import Powers
from granphon.waves.nonlinear import NonlinearWaves
from granphon.waves.operator import WaveOperator

#: difference of squared frequencies, over the highest, up to which they are equal but for rounding
_ALONE = 1e-10


def amplitude_shift(x: Any, q: ArrayLike, branch: int = 0, law: Any = None) -> float:
    """Return how the frequency of a travelling wave changes with its amplitude, to second order.

    It is (d omega/omega) (delta/A)^2, where A is the largest displacement of a ball and delta the
    mean overlap. The cell keeps its size. Normal forces follow the whole law; the stiffness against
    slip, twist and rolling is that at rest.

    Parameters
    ----------
    x : a state at one load, or a network that repeats, without ``prestress``.
    q : (p,) or (3,), wave vector in fractions of the reciprocal cell.
    branch : its number, in ascending frequency.
    law : as for :class:`NonlinearWaves`.

    Raises :class:`~granphon.base.errors.InputError` for a branch that others touch at q, or that
    costs nothing or displaces no ball, and where twice its frequency is that of a wave of 2 q.
    """
    waves = NonlinearWaves(x, law)
    if not isinstance(waves.normal, Powers):
        raise InputError(
            "the law of the contacts is no power", "Its second and third derivatives are not known"
        )
    network = waves.network
    operator = WaveOperator(waves.network)
    periods = np.flatnonzero(network.pbc)
    at = real_array("q", q)
    if at.shape not in ((len(periods),), (3,)) or not periods.size or not np.all(np.isfinite(at)):
        raise InputError(
            f"q has the shape {at.shape}", mend=f"Give ({len(periods)},) finite fractions"
        )
    require_digits(at)
    if np.any(at[len(periods) :]):
        raise InputError("q has a component across the periods", mend="Give 0 for it")
    which = whole_number("branch", branch, 0, operator.size - 1)
    n = network.n_contacts
    turn = 2.0j * np.pi * (network.shift[:, periods] @ at[: len(periods)])

    def find(times: int) -> tuple[Any, Any]:
        """Return D and the elongations (n_c, size) of the harmonic of this number, dense."""
        phase = np.exp(times * turn)
        return operator.weigh(phase=phase).toarray(), operator.compose(
            operator.law_rows, phase
        ).toarray()[:n]

    own, stretch = find(1)
    squares, vectors = np.linalg.eigh(own)
    top = operator.top**2
    if squares[which] < _ALONE * top or np.sum(np.abs(squares - squares[which]) < _ALONE * top) > 1:
        what = f"branch {which} costs nothing at this wave vector, or touches another"
        raise InputError(what, "Its wave is not known", "Take another wave vector or branch")
    vector = vectors[:, which]
    square = float(squares[which])
    moves = operator.values(vector)[:, operator.motions.translating]
    # the square of half the long axis of the ellipse of each ball
    long = 0.5 * (np.sum(np.abs(moves) ** 2, axis=1) + np.abs(np.sum(moves**2, axis=1)))
    size = float(np.sqrt(np.max(long / network.masses[operator.balls])))
    if np.sum(long) < _ALONE:
        raise InputError(
            f"balls only turn in branch {which}",
            "An amplitude is a displacement",
            "Take another branch",
        )
    # the tension of a contact is k e + second e^2 + third e^3
    a = waves.normal.exponent
    k = network.normal_stiffness
    delta = waves.overlap
    second = -0.5 * k * (a - 1.0) / delta
    third = k * (a - 1.0) * (a - 2.0) / (6.0 * delta**2)
    e, (twice, reach), (level, still) = stretch @ vector, find(2), find(0)
    if np.min(np.abs(np.linalg.eigvalsh(twice) - 4.0 * square)) < _ALONE * top:
        raise InputError(
            "twice the frequency is that of a wave of 2 q", "The two exchange energy", "Change q"
        )
    double = reach @ np.linalg.solve(
        twice - 4.0 * square * np.eye(len(twice)), -0.5 * reach.conj().T @ (second * e * e)
    )
    mean = still @ (
        np.linalg.pinv(level, rcond=_ALONE, hermitian=True)
        @ (-0.5 * still.conj().T @ (second * np.abs(e) ** 2))
    )
    tension = (
        2.0 * second * e * mean + second * e.conj() * double + 0.75 * third * np.abs(e) ** 2 * e
    )
    shift = float((e.conj() @ tension).real) / (2.0 * square)
    return shift * (float(np.mean(delta)) / size) ** 2
