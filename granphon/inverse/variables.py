"""The variables of a design: numbers of the balls or contacts of a network, one for each, or one
for all of a kind.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, brief
from granphon.base.quantities import INERTIA, MASS, STIFFNESS, TURN_STIFFNESS
from granphon.base.validation import finite_array, not_negative, one_of, texts
from granphon.networks.network import ContactNetwork

#: random starts of a search by default, its seed, and the most steps from each start
RESTARTS = 2
SEED = 0
STEPS = 200
#: what may vary: the field of a network that is the variable, the fields that change in proportion
#: with it, and of each the name of its derivative
VARIED = {
    "mass": {"masses": "mass", "inertias": "inertia"},
    "inertia": {"inertias": "inertia"},
    "stiffness": {
        "normal_stiffness": "normal_stiffness",
        "shear_stiffness": "shear_stiffness",
        "torsion_stiffness": "torsion",
        "bending_stiffness": "bending",
    },
    "normal_stiffness": {"normal_stiffness": "normal_stiffness"},
    "shear_stiffness": {"shear_stiffness": "shear_stiffness"},
    "torsion": {"torsion_stiffness": "torsion"},
    "bending": {"bending_stiffness": "bending"},
    "on_site": {"on_site": "on_site"},
}
#: the quantity of each variable by name
QUANTITIES = {
    "mass": MASS,
    "inertia": INERTIA,
    "stiffness": STIFFNESS,
    "normal_stiffness": STIFFNESS,
    "shear_stiffness": STIFFNESS,
    "torsion": TURN_STIFFNESS,
    "bending": TURN_STIFFNESS,
    "on_site": STIFFNESS,
}
#: the SI unit of each variable by name
UNITS = {name: quantity.si_unit for name, quantity in QUANTITIES.items()}
#: what may be zero in a network; masses, inertias and normal stiffnesses are above zero
_MAY_BE_ZERO = ("shear_stiffness", "torsion", "bending", "on_site")
#: what has a variable of its own: every ball or contact, or every kind
PER = ("each", "kind")
#: relative distance by which a start may lie outside of its bounds: rounding
_ROUNDING = 1e-9


@contextmanager
def about(*keys: str) -> Iterator[None]:
    """Let an InputError of the with-block say that it is about these ``keys`` of a design, unless
    the error already says what it is about.
    """
    try:
        yield
    except InputError as error:
        error.block = error.block or ("design", *keys)
        raise


@dataclass(frozen=True)
class _Group:
    """The variables of one name, as "mass".

    Attributes
    ----------
    name : the name in ``vary``.
    members : (m,) indices of the balls or contacts that vary.
    numbers : (m,) the number of the variable, from 0, that each member has.
    labels : the balls or contacts that have each variable, in words, in the order of the variables.
    """

    name: str
    members: Index
    numbers: Index
    labels: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of variables."""
        return len(self.labels)

    @property
    def fields(self) -> dict[str, str]:
        """The fields of a network that vary, each with the name of its derivative. The first one is
        the variable itself, and the others change in proportion with it.
        """
        return VARIED[self.name]

    @property
    def main_field(self) -> str:
        """The field of a network that is the variable itself."""
        return next(iter(self.fields))

    def read_bounds(self, bounds: Any, names: Sequence[str]) -> tuple[float, float]:
        """Return the least and the greatest value of the variables, SI, from the argument
        ``bounds`` of :func:`granphon.design` for all ``names``.

        InputError if there is nothing to vary, for bounds that :func:`read_bounds` refuses, and if
        the bounds begin at zero where a network must be above zero.
        """
        if not self.count:
            fault = f"the network has no {self.name} to vary"
            raise InputError(fault, "It has no contact, or no ball that moves")
        smallest, largest = read_bounds(self.name, bounds, names)
        if smallest == 0.0 and self.name not in _MAY_BE_ZERO:
            fault = f"the bounds of {self.name} begin at zero"
            raise InputError(fault, "In a network it is above zero", "Begin above zero")
        return smallest, largest


@dataclass(frozen=True)
class Variables:
    """The variables of a design.

    Attributes
    ----------
    network : the given network, in which the variables vary.
    groups : the variables of each name; all n variables come group by group.
    low, high : (n,) least and greatest values, SI.
    start : (n,) the values in the given network, SI; the mean over the members of a variable.
    """

    network: ContactNetwork
    groups: tuple[_Group, ...]
    low: Array
    high: Array
    start: Array

    @classmethod
    def of(cls, network: ContactNetwork, vary: Any, bounds: Any, per: str) -> Self:
        """Return the variables from the arguments of :func:`granphon.design`.

        InputError for a word that ``per`` does not know, for no names and unknown ones, for names
        that vary the same numbers, for a network without balls or contacts to vary, for bounds that
        :meth:`_Group.read_bounds` refuses, and for a start outside of its bounds.
        """
        one_of("per", per, PER)
        names = texts("vary", vary)
        if not names:
            raise InputError("nothing varies", mend=f"Use {', '.join(VARIED)}")
        varied_fields: list[str] = []
        for name in names:
            varied_fields += VARIED[one_of("vary", name, tuple(VARIED))]
        if len(set(varied_fields)) < len(varied_fields):
            fault = f"{' and '.join(names)} vary the same numbers of the network"
            with about("vary"):
                raise InputError(fault, mend="Leave one out")
        groups = tuple(_make_group(network, name, per) for name in names)
        low = []
        high = []
        start = []
        for group in groups:
            with about("vary", group.name):
                smallest, largest = group.read_bounds(bounds, names)
            values = _read_values(network, group.main_field, group.members)
            sums = np.bincount(group.numbers, values, group.count)
            start.append(sums / np.bincount(group.numbers, minlength=group.count))
            low.append(np.full(group.count, smallest))
            high.append(np.full(group.count, largest))
        variables = cls(
            network, groups, np.concatenate(low), np.concatenate(high), np.concatenate(start)
        )
        variables._require_inside()
        return variables

    def _require_inside(self) -> None:
        """Raise InputError if the start of a variable is out of its bounds; the message names the
        first such variable.
        """
        clauses = find_outside(self, self.units)
        if clauses:
            first = min(clauses)
            ending = f", and {len(clauses) - 1} more" if len(clauses) > 1 else ""
            mend = "Widen the bounds, or start from another network"
            names = [group.name for group in self.groups for _ in group.labels]
            with about("vary", names[first]):
                raise InputError(f"in the network {clauses[first]}{ending}", mend=mend)

    @property
    def labels(self) -> list[str]:
        """What each variable is called in messages."""
        return [f"{group.name} of {label}" for group in self.groups for label in group.labels]

    @property
    def units(self) -> list[str]:
        """The SI unit of each variable."""
        return [UNITS[group.name] for group in self.groups for _ in group.labels]

    def split(self, values: Array) -> list[Array]:
        """Return the ``values`` (n,) of the variables group by group, as views of the array."""
        return np.split(values, np.cumsum([group.count for group in self.groups])[:-1])

    def make_network(self, values: Array) -> ContactNetwork:
        """Return the given network with these ``values`` (n,) of the variables, SI. The network has
        no ``lattice`` and no ``shape``: the cells of a grid need no longer be equal.
        """
        fields: dict[str, Any] = {}
        for group, values_of_group in zip(self.groups, self.split(values), strict=True):
            new_values = values_of_group[group.numbers]
            old_values = _read_values(self.network, group.main_field, group.members)
            for name in group.fields:
                if name == "on_site":
                    fields[name] = _put_springs(self.network, group.members, new_values)
                    continue
                array = np.array(getattr(self.network, name))
                if name == group.main_field:
                    array[group.members] = new_values
                else:  # in proportion with the main field
                    array[group.members] *= new_values / old_values
                fields[name] = array
        return replace(self.network, lattice=None, shape=None, **fields)

    def chain(
        self, network: ContactNetwork, slopes: Mapping[str, Any], shape: tuple[int, ...] = ()
    ) -> Array:
        """Return the derivatives of a goal by the variables, (..., n) for n variables, from those
        by the numbers of a ``network`` that :meth:`make_network` has made.

        ``slopes`` has the latter by the names of derivatives: (..., n_c) for contacts, (..., n_b)
        for balls, and (..., n_b, motions) for springs to the ground, where ``shape`` (...) is that
        of the goal's value. Those that are left out are zero. By the chain rule the derivatives by
        the fields that change in proportion with a variable are added, and then those of all
        members that have the variable. InputError for derivatives of another shape.
        """
        columns = []
        for group in self.groups:
            values = _read_values(network, group.main_field, group.members)
            # of the derivatives by each member, (..., m)
            total = np.zeros((*shape, len(group.members)))
            for field, name in group.fields.items():
                slope = slopes.get(name)
                if slope is None:
                    continue
                derivatives = _read_slopes(network, field, name, slope, shape)
                member_slopes = derivatives[..., group.members]
                if field != group.main_field:  # a field y in proportion with x has dy/dx = y/x
                    member_slopes = member_slopes * getattr(network, field)[group.members] / values
                total += member_slopes
            sums = np.zeros((group.count, *shape))
            np.add.at(sums, group.numbers, np.moveaxis(total, -1, 0))
            columns.append(np.moveaxis(sums, 0, -1))
        return np.concatenate(columns, axis=-1)

    def read_sums(self, constraints: Mapping[str, float] | None) -> list[tuple[Array, float]]:
        """Return, for each of the ``constraints``, {name: total}, the weights (n,) with which the
        variables add up to the sum over all balls that move, or over all contacts, and the total
        that the sum keeps, SI. InputError for what is no mapping, for names that do not vary, and
        for totals that are no numbers or out of reach.
        """
        total_of_name: Any = {} if constraints is None else constraints
        if not isinstance(total_of_name, Mapping):
            mend = 'Give a mapping of a varied name to a sum, as {"mass": 0.1}'
            raise InputError(f"constraints is {brief(total_of_name)}", mend=mend)
        sums = []
        for name, total in total_of_name.items():
            with about("constraints", name):
                sums.append(self._read_sum(name, total))
        return sums

    def _read_sum(self, name: str, given_total: Any) -> tuple[Array, float]:
        """Return the weights (n,) and the total of the sum over the values of a ``name``; see
        :meth:`read_sums` for these and the errors.
        """
        names = [group.name for group in self.groups]
        one_of("constraints", name, tuple(names))
        weights = np.zeros(len(self.start))
        number = names.index(name)
        group = self.groups[number]
        # the weight of a variable is the number of balls or contacts that have it; the parts that
        # split returns are views, so that weights itself is set
        self.split(weights)[number][:] = np.bincount(group.numbers, minlength=group.count)
        total = not_negative("constraints", given_total)
        least_sum = float(weights @ self.low)
        greatest_sum = float(weights @ self.high)
        if not least_sum <= total <= greatest_sum:
            unit = UNITS[name]
            raise InputError(
                f"the sum of the {name}, {total:.6g} {unit}, is out of reach",
                f"The bounds allow {least_sum:.6g} to {greatest_sum:.6g} {unit}",
            )
        return weights, total


def _read_values(network: ContactNetwork, field: str, members: Index) -> Array:
    """Return the values (m,), SI, of a ``field`` of a ``network`` for the ``members`` (m,), indices
    of balls or contacts. For springs to the ground the value is the mean of those against the
    displacements of a ball, or zero if there are none.
    """
    values = getattr(network, field)
    if field != "on_site":
        return np.asarray(values[members])
    if values is None:
        return np.zeros(len(members))
    return np.asarray(values[members][:, network.ball_motions.translating].mean(axis=1))


def _read_slopes(
    network: ContactNetwork, field: str, name: str, slope: Any, shape: tuple[int, ...]
) -> Array:
    """Return the derivatives (..., n) of a goal by the n values of a ``field`` of a network, in
    which the spring to the ground of a ball is one value. ``slope`` holds the derivatives of the
    ``name`` that the goal gives, and ``shape`` (...) is that of the value of the goal. InputError
    for derivatives of another shape, and for such as are no finite numbers.
    """
    derivatives = finite_array(f"the derivatives by {name}", slope)
    is_on_site = field == "on_site"
    sizes: tuple[int, ...] = (network.n_balls, network.ball_motions.count)
    if not is_on_site:
        sizes = (len(getattr(network, field)),)
    if derivatives.shape != (*shape, *sizes):
        fault = f"the derivatives by {name} have the shape {derivatives.shape}"
        raise InputError(fault, mend=f"Give an array {(*shape, *sizes)}")
    if is_on_site:  # the same spring resists each of the displacements
        return np.asarray(derivatives[..., network.ball_motions.translating].sum(axis=-1))
    return derivatives


def _put_springs(network: ContactNetwork, members: Index, values: Array) -> Array:
    """Return the springs to the ground (n, motions) of a network in which those of some balls,
    ``members`` (m,), resist each displacement of a ball with the stiffness in ``values`` (m,), N/m.
    Springs against rotations, and those of other balls, stay.
    """
    springs = np.zeros((network.n_balls, network.named_motions.count))
    if network.on_site is not None:
        springs[:] = network.on_site
    springs[members, network.named_motions.translating] = values[:, None]
    return springs


def find_outside(space: Any, units: Sequence[str] = ()) -> dict[int, str]:
    """Return, by the number of the variable, a clause for each variable whose start is outside of
    its bounds; the clause has the values and, if they are given, the ``units``.

    ``space`` has ``low``, ``high``, ``start`` and ``labels``, as :class:`Variables` has.
    """
    low = space.low
    high = space.high
    start = space.start
    margin = _ROUNDING * np.maximum(np.abs(low), np.abs(high))
    outside = np.flatnonzero((start < low - margin) | (start > high + margin))
    clauses = {}
    for number in outside.tolist():
        unit = f" {units[number]}" if units else ""
        clauses[number] = (
            f"the {space.labels[number]} is {start[number]:.6g}{unit}, outside of its bounds,"
            f" {low[number]:.6g} to {high[number]:.6g}{unit}"
        )
    return clauses


def _make_group(network: ContactNetwork, name: str, per: str) -> _Group:
    """Return the variables of a ``name`` in a ``network``: one for "each" ball or contact, or one
    for all balls of a "kind" or all contacts of a pair of kinds, as ``per`` says. Balls that do not
    move have none.
    """
    kinds: list[tuple[str, ...]] | None = None
    is_of_balls = not {"masses", "inertias", "on_site"}.isdisjoint(VARIED[name])
    if is_of_balls:
        members = np.flatnonzero(network.moving)
        noun = "ball"
        if network.kinds is not None:
            kinds = [(network.kinds[ball],) for ball in members.tolist()]
    else:
        members = np.arange(network.n_contacts)
        if network.kinds is not None:
            ends = zip(network.i.tolist(), network.j.tolist(), strict=True)
            kinds = [tuple(sorted((network.kinds[i], network.kinds[j]))) for i, j in ends]
        noun = "contact"
    if per == "each":
        labels = tuple(f"{noun} {member}" for member in members)
        return _Group(name, members, np.arange(len(members)), labels)
    kinds_of_members = kinds or [()] * len(members)  # without kinds all have one variable
    unique_kinds = sorted(set(kinds_of_members))
    numbers = np.array([unique_kinds.index(kind) for kind in kinds_of_members], np.intp)
    labels = tuple("-".join(kind) or f"all {noun}s" for kind in unique_kinds)
    return _Group(name, members, numbers, labels)


def read_bounds(name: str, bounds: Any, names: Sequence[str]) -> tuple[float, float]:
    """Return the least and the greatest value, SI, of the variables of a ``name``.

    ``bounds`` are a pair (low, high), or a mapping of names to such pairs, which is needed if
    several ``names`` vary. InputError for a mapping without the ``name``, for other bounds, and
    unless 0 <= low < high.
    """
    limits = bounds
    if isinstance(bounds, Mapping):
        if name not in bounds:
            raise InputError(f"{name} has no bounds", mend=f"Give bounds of {', '.join(names)}")
        limits = bounds[name]
    elif len(names) > 1:
        mend = f"Give a mapping, with bounds of {', '.join(names)}"
        raise InputError(f"bounds is {brief(bounds)}, and {len(names)} names vary", mend=mend)
    ends = finite_array("bounds", limits)
    if ends.shape != (2,) or not 0.0 <= ends[0] < ends[1]:
        raise InputError(
            f"the bounds of {name} are {ends.tolist()}",
            mend="Give the least and the greatest value, (low, high), from zero on",
        )
    return float(ends[0]), float(ends[1])
