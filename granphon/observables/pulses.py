"""Pulses of finite frequency: phase and group velocities of the acoustic branches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import as_direction
from granphon.base.arguments import finite_array, texts
from granphon.base.errors import InputError, UnreachableFrequencyError, brief, message
from granphon.base.results import Result
from granphon.dynamics.branches import AcousticBranch, AcousticBranches
from granphon.dynamics.modes import ContactLattice
from granphon.media.acoustics import contact_lattice
from granphon.media.state import ContactState, with_keyword
from granphon.observables.validity import validity

__all__ = ["PulseVelocities", "pulse_velocities"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class PulseVelocities(Result):
    """Phase and group velocity of a pulse of given frequency, m/s.

    Attributes
    ----------
    branches : names of the branches, along the first axis of the arrays; then come loads and frequencies, then directions.
    phase : (n_branches, ...) phase velocity, m/s.
    group : (n_branches, ...) m/s, the component of the group velocity along the wave vector, d omega/dq in its direction.
    group_vector : (n_branches, ..., 2) m/s, the group velocity itself: the direction and speed of the flow of energy.
    wavenumber : (n_branches, ...) rad/m.
    frequency : the given frequencies, Hz.
    direction : unit vector of the wave vector, (2,) or (n, 2).
    warnings : one sentence for each limit of the model that the state exceeds.
    """

    units = {"phase": "m/s", "group": "m/s", "group_vector": "m/s", "wavenumber": "rad/m", "frequency": "Hz"}
    shapes = {"branches": "b", "direction": "2|n 2"}

    branches: tuple[str, ...]
    phase: Array
    group: Array
    group_vector: Array
    wavenumber: Array
    frequency: Any
    direction: Array
    warnings: tuple[str, ...]


def pulse_velocities(
    state: ContactState,
    frequency: ArrayLike,
    direction: ArrayLike = (1.0, 0.0),
    finite_overlap: bool | None = None,
    branches: str | Sequence[str] = ("longitudinal", "transverse"),
) -> PulseVelocities:
    """Return phase and group velocity of the acoustic branches at a given frequency, m/s.

    Both are below the velocity of long waves.

    Parameters
    ----------
    state : the state of the contacts, at one load or many.
    frequency : Hz; a scalar or an array that broadcasts against the load.
    direction : direction of the wave vector, Cartesian, (2,), or (n, 2) for many at once. In the named lattices (1, 0) is
        along a row of touching balls: Gamma-K of the triangular and kagome lattices (where (0, 1) is Gamma-M), and Gamma-X
        of the square lattice.
    finite_overlap : deprecated; the state says whether overlap is finite.
    branches : names of the branches, in the order of the result.

    For a simulation the branches are those of the ideal lattice, each scaled to the long-wave velocity of the samples.

    Returns
    -------
    :class:`PulseVelocities`; the wavenumber solves the dispersion relation to rounding. Its ``group`` is the component of
    the group velocity along the wave vector; the vector itself, which points elsewhere off the axes of symmetry, is
    ``group_vector``. Arrays run over the branches, then loads and frequencies, then directions.

    Raises
    ------
    UnreachableFrequencyError : a branch ends, at its first maximum or the zone edge, below the frequency.
    InputError : a frequency that is not finite and above zero; an unknown branch; a direction that is not two finite numbers
        or has no length; frequencies whose shape does not broadcast against the load.
    """
    state = with_keyword(state, finite_overlap)
    hertz = finite_array("frequency", frequency, "Hz", "above zero")
    names = texts("branches", branches)
    unknown = [name for name in names if name not in ("longitudinal", "transverse")]
    if unknown or not names:
        raise InputError(message(f"unknown branch {brief(unknown)}", mend="Use longitudinal, transverse or both"))
    d, along = state.packing.diameter, as_direction(direction)
    scales = state.branch_scales(along, names)
    axes = along.ndim - 1
    try:
        shape = np.broadcast_shapes(hertz.shape, state.shape)
    except ValueError:
        raise InputError(
            message(
                f"the frequencies have the shape {hertz.shape}, and the loads {state.shape}",
                mend="Give one frequency, or shapes that numpy can broadcast",
            )
        ) from None
    scale = np.stack([np.broadcast_to(one, shape + along.shape[:-1]) for one in scales])
    target = 2.0 * np.pi * hertz.reshape(hertz.shape + (1,) * axes) * d / scale
    # shape (branches, loads and frequencies, directions)
    flat = (len(names), -1, len(along.reshape(-1, 2)))
    target, units = target.reshape(flat), scale.reshape(flat) / d
    # in the paper's limit all loads share one dispersion relation; with finite overlap each load has its own
    parts: list[tuple[ContactState, slice]] = [(state, slice(None))]
    if state.finite_overlap and state.shape:
        force, overlap, stiffness = (
            np.broadcast_to(values, shape).ravel() for values in (state.force, state.overlap, state.normal_stiffness)
        )
        every = replace(state, force=force, overlap=overlap, normal_stiffness=stiffness)
        parts = [(every[index], slice(index, index + 1)) for index in range(target.shape[1])]
    wavenumber, vector = np.empty(target.shape), np.empty((*target.shape, 2))
    for part, here in parts:
        wavenumber[:, here], vector[:, here] = _find_wavenumbers(
            contact_lattice(part), along.reshape(-1, 2), names, target[:, here], units[:, here]
        )
    group = np.sum(vector * along.reshape(-1, 2), axis=-1)
    phase = (target / wavenumber).reshape(scale.shape) * scale
    return PulseVelocities(
        names, phase, group.reshape(scale.shape) * scale, vector.reshape(*scale.shape, 2) * scale[..., None],
        wavenumber.reshape(scale.shape) / d, hertz, along, validity(state).warnings,
    )  # fmt: skip


def _find_wavenumbers(
    lattice: ContactLattice, along: Array, names: Sequence[str], target: Array, scale: Array
) -> tuple[Array, Array]:
    """Find wavenumber (b, m, n) and group velocity (b, m, n, 2), in reduced units, in directions ``along`` (n, 2).

    ``target`` (b, m, n) holds angular frequencies in units of ``scale`` (rad/s).
    """
    places = [("longitudinal", "transverse").index(name) for name in names]
    wanted = np.full((2, len(along)), -np.inf)
    wanted[places] = target.max(axis=1)
    both = AcousticBranches.follow(lattice, along, wanted)
    q, group = np.empty(target.shape), np.empty((*target.shape, 2))
    row = np.arange(len(along))
    for one, which in enumerate(places):
        last = np.where(both.rising[which] > 0, both.frequencies[which, row, both.rising[which] - 1], 0.0)
        beyond = wanted[which] > last
        # directions are solved together if the frequency is below the last point before the maximum; the others one by one
        inside = np.flatnonzero(~beyond)
        if inside.size:
            flat = np.broadcast_to(inside, (target.shape[1], len(inside))).ravel()
            found = both.find_wavenumber(which, flat, target[one][:, inside].ravel())
            q[one][:, inside] = found[0].reshape(-1, len(inside))
            group[one][:, inside] = found[1].reshape(-1, len(inside), 2)
        for place in np.flatnonzero(beyond).tolist():
            goal, unit = target[one, :, place], scale[one, :, place]
            branch = both.take_branch(which, place)
            if np.any(goal > branch.top):
                raise _explain_unreachable(branch, goal, unit)
            q[one, :, place], group[one, :, place] = branch.find_pulse(goal)
    return q, group


def _explain_unreachable(branch: AcousticBranch, target: Array, scale: Array) -> UnreachableFrequencyError:
    """Return the error for angular frequencies (in units of ``scale``, rad/s) above the top of a branch."""
    wanted, top = (float(np.max(target * scale)), float(np.min(branch.top * scale)))
    return UnreachableFrequencyError(
        message(
            f"the {branch.name} branch does not reach {wanted / (2.0 * np.pi):.6g} Hz in direction"
            f" ({branch.direction[0]:.6g}, {branch.direction[1]:.6g})",
            f"It ends at {top / (2.0 * np.pi):.6g} Hz" + (" at the least load" if np.ptp(scale) > 0.0 else ""),
            "Lower the frequency, or name the branches that reach it",
        )
    )
