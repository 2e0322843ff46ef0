"""Springs to the ground: what stiffness holds each motion of a ball, beside its contacts.

Magnets, grooves, rods and soft foundations hold balls so. A spring pulls a ball back to the place
at which the ball touches its neighbours without load, along the axis of a motion; a spring of a
rotation turns the ball back. Springs have no length: the strain of a cell does not stretch them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.hertz import ENERGY, FORCE, STIFFNESS, EnergyLaw
from granphon.balls.motions import Motions
from granphon.base import quantities
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import Quantity
from granphon.base.results import read_only
from granphon.base.text import counted
from granphon.base.validation import block, require, zero_or_above

#: greatest stiffness, N/m or N m, far above any: products of several are within the range of floats
_MOST_STIFFNESS = 1e30
#: name under which one stiffness of all rotations is given, N m
ROTATION = "rotation"
#: names of the stiffnesses against displacements along x, y and z, N/m, and against rotations about
#: these axes, N m
DISPLACEMENTS = ("x", "y", "z")
ROTATIONS = tuple(f"{ROTATION}_{axis}" for axis in DISPLACEMENTS)
#: name of the stiffnesses of springs to the ground
ON_SITE = "on_site"
#: part of a stiffness that couples two motions, over the largest, that is put down to rounding
_COUPLING_ROUNDING = 1e-9


@dataclass(frozen=True)
class SpringLaw(EnergyLaw):
    """The law f = k u of a spring to the ground, which pushes and pulls; ``constant`` is k, N/m,
    above zero, and the displacement u, m, stands for the overlap.
    """

    constant: float

    @property
    def least_overlap(self) -> float:
        """-inf: a spring never opens."""
        return -np.inf

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy k u^2/2, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at
        each ``overlap`` u, m.
        """
        u = np.asarray(overlap, float)
        if order == ENERGY:
            return self.constant * u * (0.5 * u)
        if order == FORCE:
            return self.constant * u
        return np.full(u.shape, self.constant if order == STIFFNESS else 0.0)[()]

    def overlap(self, force: ArrayLike) -> Any:
        """Return the displacement f/k, m, at a ``force`` f, N, unchecked."""
        return np.asarray(force, float) / self.constant


def name_springs(motions: Motions) -> tuple[str, ...]:
    """Return the name of the spring of each of the ``motions``: "x", "rotation_z" and so on."""
    displacements = [DISPLACEMENTS[axis] for axis in motions.translations]
    return (*displacements, *(ROTATIONS[axis] for axis in motions.rotations))


def read_on_site(value: Any, motions: Motions, n: int) -> Array | None:
    """Return the stiffnesses (n, motions) of the springs to the ground of n balls, N/m against
    displacements and N m against rotations; None without springs.

    ``value`` is one of these:

    - None;
    - one stiffness of all displacements, N/m;
    - a mapping from names to stiffnesses: "x", "y" and "z" of displacements, N/m, "rotation" of all
      rotations, and "rotation_x" and so on of one rotation, N m;
    - a list of n such numbers or mappings, one for each ball;
    - the array (n, motions).

    Raises :class:`~granphon.base.errors.InputError` for something else, a stiffness below zero,
    above 1e30 or not finite, a motion that balls do not have, and a list of another length.
    """
    if value is None:
        return None
    entries = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(entries, list | tuple):
        springs = np.tile(_read_springs(entries, motions), (n, 1))
    elif len(entries) == n:
        springs = np.array([_read_springs(entry, motions) for entry in entries])
    else:
        entries_in_words = counted(len(entries), "entry", "entries")
        problem = f"on_site has {entries_in_words}, and the number of balls is {n}"
        raise InputError(problem, mend="Give one for each ball, or one stiffness for all")
    return read_only(springs) if np.any(springs) else None


def _read_springs(value: Any, motions: Motions) -> list[float]:
    """Return the stiffness of the spring of each of the ``motions`` of a ball, from what
    :func:`read_on_site` takes for a ball, or from a list of these stiffnesses; InputError for
    another value.
    """
    names = name_springs(motions)
    if isinstance(value, list | tuple) and len(value) == len(names):
        value = dict(zip(names, value, strict=True))
    if not isinstance(value, Mapping):
        rule = partial(_read_stiffness, unit=SPRING_PARAMETERS[ON_SITE])
        stiffness: float = require("on_site", rule, value)
        return [0.0 if name in ROTATIONS else stiffness for name in names]
    allowed_names = (*names, ROTATION) if motions.rotations else names
    rules = {name: partial(_read_stiffness, unit=find_unit(name)) for name in allowed_names}
    stiffnesses = require("on_site", partial(block, rules=rules), value)
    rotation_stiffness = stiffnesses.get(ROTATION, 0.0)  # of rotations without one of their own
    defaults = {name: rotation_stiffness if name in ROTATIONS else 0.0 for name in names}
    return [stiffnesses.get(name, defaults[name]) for name in names]


def _read_stiffness(value: Any, unit: str) -> float:
    """Return a stiffness, zero or above, in an SI ``unit``; refuse one above the greatest."""
    stiffness = zero_or_above(value, unit)
    if stiffness > _MOST_STIFFNESS:
        raise Refused(f"{stiffness:g}", f"a stiffness up to {_MOST_STIFFNESS:g} {unit}")
    return stiffness


def find_quantity(name: str) -> Quantity:
    """Return the quantity, with its unit, of the stiffness of the spring called ``name``."""
    is_of_rotation = name.startswith(ROTATION)
    return quantities.TURN_STIFFNESS if is_of_rotation else quantities.STIFFNESS


def find_unit(name: str) -> str:
    """Return the SI unit of the stiffness of the spring called ``name``."""
    return find_quantity(name).si_unit


#: the parameters of springs to the ground that a sweep varies, and their SI units: one stiffness of
#: all displacements, and those of single motions
SPRING_PARAMETERS = {ON_SITE: quantities.STIFFNESS.si_unit} | {
    f"{ON_SITE}.{name}": find_unit(name) for name in (*DISPLACEMENTS, ROTATION, *ROTATIONS)
}
#: the names of those springs that hold balls in their place, so that there is no sound
HOLDING_PARAMETERS = frozenset(
    name for name, unit in SPRING_PARAMETERS.items() if unit == quantities.STIFFNESS.si_unit
)


def list_spring_parameters(motions: Motions) -> list[str]:
    """Return those of :data:`SPRING_PARAMETERS` that balls of these ``motions`` have."""
    names = [*name_springs(motions), *([ROTATION] if motions.rotations else [])]
    return [ON_SITE, *(f"{ON_SITE}.{name}" for name in names)]


def change_springs(
    on_site: Array | None, changes: Mapping[str, float], motions: Motions, n: int
) -> Array:
    """Return the stiffnesses (n, motions) of the springs of n balls after ``changes``, in a new
    array. ``on_site`` (n, motions) are the stiffnesses before, None without springs.

    ``changes`` are new stiffnesses, N/m or N m, by their names in :data:`SPRING_PARAMETERS`. Each
    change applies to all balls, and to all ``motions`` that its name stands for; where two changes
    stand for one motion, the later one holds.
    """
    springs = np.zeros((n, motions.count)) if on_site is None else on_site.copy()
    for parameter, stiffness in changes.items():
        springs[:, _flag_motions(parameter, motions)] = stiffness
    return springs


def find_stiffness(on_site: Array | None, parameter: str, motions: Motions) -> float | None:
    """Return the one stiffness, N/m or N m, of all springs for which the ``parameter``, one of
    :data:`SPRING_PARAMETERS`, stands.

    ``on_site`` (n, motions) are the stiffnesses of the springs of n balls, or None without springs,
    whose stiffness is zero. Returns None if these springs have several stiffnesses, or if the
    parameter stands for none of the ``motions`` of the balls.
    """
    is_named = _flag_motions(parameter, motions)
    if on_site is None:
        return 0.0 if any(is_named) else None
    stiffnesses = np.unique(on_site[:, is_named])
    return float(stiffnesses[0]) if stiffnesses.size == 1 else None


def _flag_motions(parameter: str, motions: Motions) -> list[bool]:
    """Return for each of the ``motions`` whether the ``parameter``, one of
    :data:`SPRING_PARAMETERS`, stands for the spring of this motion.
    """
    _, _, spring = parameter.partition(".")
    names_of_groups = {"": DISPLACEMENTS, ROTATION: ROTATIONS}
    names = names_of_groups.get(spring, (spring,))
    return [name in names for name in name_springs(motions)]


def turn_on_site(on_site: Array | None, turn: Array, motions: Motions) -> Array | None:
    """Return the stiffnesses ``on_site`` (n, motions) of springs to the ground after a rotation
    ``turn`` (d, d), whose rows are the new axes; None without springs.

    Raises :class:`~granphon.base.errors.InputError` where a spring would lie across two new axes.
    """
    d = len(turn)
    if on_site is None or np.array_equal(turn, np.eye(d)):
        return on_site
    axes = np.eye(3)
    axes[:d, :d] = turn
    turned_springs = np.zeros_like(on_site)
    for columns, motion_axes in (
        (motions.translating, motions.translations),
        (motions.turning, motions.rotations),
    ):
        springs = np.zeros((len(on_site), 3))
        springs[:, motion_axes] = on_site[:, columns]
        # the stiffness of each ball as a tensor (n, 3, 3) along the new axes: the sum over the old
        # axes b of R_ab k_b R_cb
        tensors = np.einsum("ab,nb,cb->nac", axes, springs, axes)
        diagonal = np.diagonal(tensors, axis1=1, axis2=2)  # (n, 3)
        couplings = np.abs(tensors - diagonal[:, :, None] * np.eye(3))
        if np.max(couplings, initial=0.0) > _COUPLING_ROUNDING * np.max(springs, initial=0.0):
            raise InputError(
                "springs to the ground differ along axes that are turned",
                "Each spring lies along an axis of the balls, and would lie across two",
                "Give on_site the same number along these axes, or choose another axis",
            )
        turned_springs[:, columns] = diagonal[:, motion_axes]
    return read_only(turned_springs)
