"""Pulses of finite frequency: phase and group velocities of the acoustic branches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, UnreachableFrequencyError, brief, message
from granphon.base.results import Result
from granphon.base.validation import finite_array, texts
from granphon.dynamics.branches import AcousticBranch, AcousticBranches, follow_acoustic_branches
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.media.network_state import as_state
from granphon.observables.validity import find_warnings
from granphon.observables.velocities import choose_direction

Array = NDArray[np.float64]
#: top of a branch, (k/M)^1/2, that is zero but for rounding
_NO_FREQUENCY = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class PulseVelocities(Result):
    """Phase and group velocity of a pulse of given frequency, m/s.

    Attributes
    ----------
    branches : names of the branches, along the first axis of all arrays; then come loads and frequencies, then directions.
    phase : (n_branches, ...) phase velocity, m/s.
    group : (n_branches, ...) m/s, the component of the group velocity along the wave vector, d omega/dq in its direction.
    group_vector : (n_branches, ..., p) m/s, the group velocity itself: the direction and speed of the flow of energy. Where
        two branches coincide along an axis of symmetry it is the mean of both.
    wavenumber : (n_branches, ...) rad/m.
    frequency : the given frequencies, Hz.
    direction : unit vector of the wave vector, (p,) or (n, p).
    warnings : one sentence for each limit of the model that the state exceeds.
    """

    units = {"phase": "m/s", "group": "m/s", "group_vector": "m/s", "wavenumber": "rad/m", "frequency": "Hz"}
    _shapes = {"branches": "b", "direction": "p|n p"}

    branches: tuple[str, ...]
    phase: Array
    group: Array
    group_vector: Array
    wavenumber: Array
    frequency: Any
    direction: Array
    warnings: tuple[str, ...]


def pulse_velocities(
    state: Any,
    frequency: ArrayLike,
    direction: ArrayLike | None = None,
    branches: str | Sequence[str] | None = None,
) -> PulseVelocities:
    """Return phase and group velocity of the acoustic branches at a given frequency, m/s.

    Both are below the velocity of long waves, except where that is zero: waves of finite length travel across a plane or a
    chain of balls if contacts resist torsion or bending.

    Parameters
    ----------
    state : the state of the contacts, at one load or many; or a sample or network, as in :func:`sound_velocities`.
    frequency : Hz; a scalar or an array that broadcasts against the load.
    direction : direction of the wave vector, Cartesian, (p,) for a lattice with p periods, or (n, p) for many at once. It
        may be left out on a chain, and where sound in the plane is isotropic, as on the triangular lattice: it is then x.
        In the named plane lattices (1, 0) is along a row of touching balls: Gamma-K of the triangular and kagome lattices
        (where (0, 1) is Gamma-M), and Gamma-X of the square lattice. In cubic ones x is along the cube.
    branches : names of the branches, in the order of the result: "longitudinal" and "transverse"; in space, and on a chain
        that moves both ways across itself, "transverse_slow" and "transverse_fast"; "out_of_plane" on a plane of balls that
        move across it (:attr:`ContactState.wave_names`). By default those whose long waves have a velocity above zero, or
        all if there are none.

    For a simulation the branches are those of the ideal lattice, each scaled to the long-wave velocity of the samples.

    Returns
    -------
    :class:`PulseVelocities`; the wavenumber solves the dispersion relation to rounding. Its ``group`` is the component of
    the group velocity along the wave vector; the vector itself, which points elsewhere off the axes of symmetry, is
    ``group_vector``. Arrays run over the branches, then loads and frequencies, then directions: the branches are first here,
    and not last, so that ``phase[0]`` is that of the first branch.

    Raises
    ------
    UnreachableFrequencyError : a branch ends, at its first maximum or the zone edge, below the frequency; or its waves cost
        no energy in that direction.
    InputError : a frequency that is not finite and above zero; an unknown branch; no direction where velocities depend on
        it; a direction that is not p finite numbers or has no length; frequencies whose shape does not broadcast against the
        load.
    MechanismError : a motion of the lattice costs no energy.
    """
    state = as_state(state)
    hertz = finite_array("frequency", frequency, "Hz", "above zero")
    d, periods = state.unit_length, state.reference_lattice.periods
    even = periods == 1 or ("longitudinal" in state.wave_names and state.is_isotropic)
    along = choose_direction(state, direction, "pulses", even)
    known = state.wave_names
    if branches is None:
        v = state.long_waves(along).reshape(-1, len(known))
        names = tuple(name for name, one in zip(known, v.T, strict=True) if np.all(one > 0.0)) or known
    else:
        names = texts("branches", branches)
        unknown = [name for name in names if name not in known]
        if unknown or not names:
            among = "longitudinal, transverse or both" if known == ("longitudinal", "transverse") else ", ".join(known)
            raise InputError(message(f"unknown branch {brief(unknown)}", mend=f"Use {among}"))
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
    with np.errstate(over="ignore"):  # infinity is beyond every branch, too
        target = hertz.reshape(hertz.shape + (1,) * axes) * (2.0 * np.pi * d / scale)
    if np.min(target) < np.finfo(float).tiny:
        what = f"a frequency of {np.min(hertz):.6g} Hz has lost digits in double precision"
        raise InputError(message(what, mend="Raise it: the velocities are those of long waves, gp.sound_velocities"))
    # shape (branches, loads and frequencies, directions)
    many = along.reshape(-1, periods)
    flat = (len(names), -1, len(many))
    target, units = target.reshape(flat), scale.reshape(flat) / d
    # in the paper's limit all loads share one dispersion relation; with finite overlap, or the torsion of a Hertz contact,
    # each load has its own
    parts: list[tuple[Any, slice]] = [(state, slice(None))]
    if not state.has_one_lattice:
        size = math.prod(state.shape)
        loads = np.broadcast_to(np.arange(size).reshape(state.shape), shape).ravel().tolist()
        each = [parts[0][0][np.unravel_index(load, state.shape)] for load in range(size)]
        parts = [(each[load], slice(index, index + 1)) for index, load in enumerate(loads)]
    wavenumber, vector = np.empty(target.shape), np.empty((*target.shape, periods))
    for part, here in parts:
        wavenumber[:, here], vector[:, here] = _find_wavenumbers(
            part.contact_lattice(), many, names, target[:, here], units[:, here]
        )
    group = np.sum(vector * many, axis=-1)
    phase = (target / wavenumber).reshape(scale.shape) * scale
    return PulseVelocities(
        names, phase, group.reshape(scale.shape) * scale, vector.reshape(*scale.shape, periods) * scale[..., None],
        wavenumber.reshape(scale.shape) / d, hertz, along, find_warnings(state),
    )  # fmt: skip


def _find_wavenumbers(
    lattice: ContactLattice, along: Array, names: Sequence[str], target: Array, scale: Array
) -> tuple[Array, Array]:
    """Find wavenumber (b, m, n) and group velocity (b, m, n, p), in reduced units, in directions ``along`` (n, p).

    ``target`` (b, m, n) holds angular frequencies in units of ``scale`` (rad/s).
    """
    places = [lattice.wave_names.index(name) for name in names]
    wanted = np.full((len(lattice.wave_names), len(along)), -np.inf)
    wanted[places] = target.max(axis=1)
    every = AcousticBranches.follow(lattice, along, wanted)
    q, group = np.empty(target.shape), np.empty((*target.shape, along.shape[1]))
    row = np.arange(len(along))
    for one, which in enumerate(places):
        last = np.where(every.rising[which] > 0, every.frequencies[which, row, every.rising[which] - 1], 0.0)
        beyond = wanted[which] > last
        # directions are solved together if the frequency is below the last point before the maximum; the others one by one
        inside = np.flatnonzero(~beyond)
        if inside.size:
            flat = np.broadcast_to(inside, (target.shape[1], len(inside))).ravel()
            found = every.find_wavenumber(which, flat, target[one][:, inside].ravel())
            q[one][:, inside] = found[0].reshape(-1, len(inside))
            group[one][:, inside] = found[1].reshape(*target[one][:, inside].shape, -1)
        for place in np.flatnonzero(beyond).tolist():
            goal, unit = target[one, :, place], scale[one, :, place]
            branch = every.take_branch(which, place)
            if np.any(goal > branch.top):
                raise _explain_unreachable(branch, goal, unit)
            q[one, :, place], group[one, :, place] = branch.find_pulse(goal)
    return q, group


def _explain_unreachable(branch: AcousticBranch, target: Array, scale: Array) -> UnreachableFrequencyError:
    """Return the error for angular frequencies (in units of ``scale``, rad/s) above the top of a branch."""
    wanted, top = float(np.max(target / (2.0 * np.pi) * scale)), float(np.min(branch.top * scale))
    along = f"in direction ({', '.join(f'{one:.6g}' for one in branch.direction)})"
    if branch.top <= _NO_FREQUENCY:

        def travels(other: ContactLattice) -> bool:
            found = follow_acoustic_branches(other, branch.direction)
            return branch.name in found and found[branch.name].top > _NO_FREQUENCY

        remedy = branch.lattice.find_remedy(travels)
        return UnreachableFrequencyError(
            message(
                f"the {branch.name} branch has no pulses {along}",
                "Its waves cost no energy there, as they deform no contact, so that their frequency is zero",
                f"{remedy.capitalize()}, or name other branches",
            )
        )
    ends = f"It ends at {top / (2.0 * np.pi):.6g} Hz" + (" at the least load" if np.ptp(scale) > 0.0 else "")
    return UnreachableFrequencyError(
        message(
            f"the {branch.name} branch does not reach {wanted:.6g} Hz {along}",
            ends,
            "Lower the frequency, or name the branches that reach it",
        )
    )
