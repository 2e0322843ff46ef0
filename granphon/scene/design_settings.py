"""The settings of the design of a scene: the goal, what varies, and the bounds.

What varies are parameters of the scene, as a sweep names them, and its load; or numbers of the
balls and contacts of its network. Goals are imported where one is made: other scenes need no
phonons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.on_site import SPRING_PARAMETERS
from granphon.balls.packing import LOSSES, PARAMETERS, find_unit
from granphon.base.errors import Refused
from granphon.base.quantities import (
    FREQUENCY,
    LOADS,
    find_load_unit,
    load_quantities,
)
from granphon.base.settings import (
    Kind,
    ValueContext,
    block_of,
    list_settings,
    listed,
    read_counts,
    setting,
    whole_from,
    with_unit,
    word_of,
)
from granphon.base.tables import Table
from granphon.base.text import closest, show
from granphon.base.validation import (
    Rule,
    choice,
    each,
    fraction,
    read_inside,
    real_number,
    truth,
)
from granphon.inverse.variables import PER, QUANTITIES, RESTARTS, SEED, STEPS, UNITS, VARIED
from granphon.media.network_file import NetworkMedium
from granphon.scene.file_keys import find_kind, refusing
from granphon.waves.settings import DIRECTION, NetworkSettings, ResponseSettings, find_place

#: the kinds of the numbers of a network
_NUMBERS = {name: with_unit(quantity) for name, quantity in QUANTITIES.items()}
#: blocks whose names may stand before a parameter of theirs, as in load.force
_PREFIXES = ("load.", "material.", "packing.")
#: most points of the mesh of a gap along each period
_MOST_POINTS = 1000


# -- the goal --------------------------------------------------------------------------------------


def _frequencies_kind(column: str) -> Kind:
    """Return the kind of several frequencies: a list, or in a file the name of a table that has
    them in its ``column``.
    """
    list_kind = listed(with_unit(FREQUENCY), "frequencies")

    def read(value: Any, context: ValueContext) -> tuple[float, ...]:
        """Return the frequencies, Hz, of a list or of the table that a text names."""
        if not (isinstance(value, str) and context.written):
            return list_kind.read(value, context)  # type: ignore[no-any-return]
        with refusing(value, f"a list, as [6.5 kHz], or a table with a column {column}"):
            table = Table.read(context.folder / value, quoted=False)
            return tuple(table.column(column, FREQUENCY).tolist())

    return Kind(read, list_kind.write, FREQUENCY.unit)


def _read_sigma(value: Any, context: ValueContext) -> Any:
    """Return one standard error, Hz, from a number, or a tuple of standard errors, Hz, from a list
    or the name of a table. A text that begins with a digit is a number with its unit.
    """
    is_number = isinstance(value, float | int) or (isinstance(value, str) and value[:1].isdecimal())
    kind = with_unit(FREQUENCY) if is_number else _frequencies_kind("sigma")
    return kind.read(value, context)


def _write_sigma(sigma: Any, context: ValueContext) -> Any:
    """Return plain data for one standard error, Hz, or for a tuple of standard errors."""
    kind = _frequencies_kind("sigma") if isinstance(sigma, tuple) else with_unit(FREQUENCY)
    return kind.write(sigma, context)


def _read_qpoints(value: Any) -> tuple[tuple[float, ...], ...]:
    """Return wave vectors, (n_q, p) in fractions of the reciprocal cell, from a list in which each
    wave vector is a text such as "1/3 1/3", a list of numbers, or on a chain a number.
    """

    def read_point(point: Any) -> tuple[float, ...]:
        """Return the components (p,) of one wave vector."""
        words: Any = point.split() if isinstance(point, str) else point
        if not isinstance(words, list | tuple):
            words = [words]
        return each(words, partial(fraction, largest=1e3), "numbers")

    return each(value, read_point, "wave vectors")


class _Form(NamedTuple):
    """The form of a goal in a file.

    Attributes
    ----------
    goal : name of the class of granphon that is the goal.
    keys : the kinds of the goal's numbers, by their keys.
    needed : the keys that a file must give.
    """

    goal: str
    keys: Mapping[str, Kind]
    needed: tuple[str, ...] = ()


_OF_RESPONSE = {
    name: declared.kind
    for name, declared in list_settings(ResponseSettings).items()
    if name not in ("frequencies", "repeat", "cut")
}
_WHOLE_NUMBERS = Kind.plain(lambda value: read_counts(value, "numbers", 0, 1_000_000), list)
#: the goals by their names
GOALS = {
    "widest_gap": _Form(
        "WidestGap",
        {
            "near": with_unit(FREQUENCY),
            "mesh": Kind.plain(
                lambda value: read_counts(value, "numbers of wave vectors", 1, _MOST_POINTS), list
            ),
            "branches": whole_from(1),
            "smoothing": with_unit(FREQUENCY),
        },
    ),
    "match_frequencies": _Form(
        "MatchFrequencies",
        {
            "measured": _frequencies_kind("frequency"),
            "sigma": Kind(_read_sigma, _write_sigma),
            "q": Kind.plain(_read_qpoints, lambda points: [list(point) for point in points]),
            "branches": _WHOLE_NUMBERS,
        },
        ("measured",),
    ),
    "lowest_velocity": _Form("LowestVelocity", {"direction": DIRECTION, "wave": whole_from(0)}),
    "response_at": _Form(
        "ResponseAt",
        {"frequency": with_unit(FREQUENCY), "largest": Kind.plain(truth), **_OF_RESPONSE},
        ("frequency", "source", "receiver"),
    ),
}


def _read_goal(value: Any, context: ValueContext) -> tuple[str, tuple[tuple[str, Any], ...]]:
    """Return the name of a goal, and its numbers in SI units as pairs of a key and a value.

    The ``value`` is the name alone, a block of numbers under the name, or the pair that this
    function returned for another scene. Refused for an unknown goal, and for numbers that the goal
    does not accept.
    """
    name = value
    numbers: Any = {}
    if isinstance(value, tuple) and len(value) == 2:
        name, entries_read = value
        numbers = dict(entries_read)
    elif isinstance(value, Mapping) and len(value) == 1:
        ((name, numbers),) = value.items()
    if not isinstance(name, str):
        allowed = f"one of {', '.join(GOALS)}, with its numbers, as {{widest_gap: {{near: 5 kHz}}}}"
        raise Refused(show(value), allowed)
    form = GOALS[choice(name, tuple(GOALS))]
    rule = block_of(form.keys, form.needed).rule(context)
    entries = read_inside(name, rule, numbers or {})
    with refusing(numbers or name, f"numbers of the goal {name}", name):
        _make_goal(name, entries)  # made here only to check the numbers
    return name, tuple(entries.items())


def _write_goal(goal: tuple[str, Any], context: ValueContext) -> Any:
    """Return the name of a goal without numbers, or else the block of its numbers under the name.

    The ``goal`` is the pair that :func:`_read_goal` returns.
    """
    name, entries = goal
    return {name: block_of(GOALS[name].keys).write(dict(entries), context)} if entries else name


def _make_goal(name: str, entries: Mapping[str, Any]) -> Any:
    """Return the goal called ``name`` in a file, an instance of its class, with the numbers
    ``entries`` by key; sources and receivers, which are words in a file, become places.
    """
    import granphon  # other scenes need no phonons, which goals import

    arguments = dict(entries)
    for key in ("source", "receiver"):
        if key in arguments:
            arguments[key] = [find_place(words) for words in arguments[key]]
    return getattr(granphon, GOALS[name].goal)(**arguments)


def named_tables_of_goal(goal: Any) -> list[str]:
    """Return the names of the tables of frequencies that the ``goal`` of a valid scene file, plain
    data, refers to.
    """
    numbers = goal.get("match_frequencies", {}) if isinstance(goal, Mapping) else {}
    names = (numbers.get(key) for key in ("measured", "sigma"))
    # a text that begins with a digit is a standard error with its unit, such as "5 Hz"
    return [name for name in names if isinstance(name, str) and not name[:1].isdecimal()]


# -- what varies -----------------------------------------------------------------------------------


def _list_names(context: Any) -> tuple[list[str], list[str]]:
    """Return two lists of names that may vary: the kinds of load and the parameters of the scene
    that are numbers; and the numbers of its network, without those that are parameters too.
    """
    all_parameters = getattr(context, "parameters", ()) or [
        name for name in PARAMETERS if find_unit(name) is not None
    ]
    parameters = [
        name for name in all_parameters if name not in SPRING_PARAMETERS and name not in LOSSES
    ]
    return [*LOADS, *parameters], [name for name in _NUMBERS if name not in parameters]


def _choose_kind(name: str, context: Any) -> Kind:
    """Return the kind of value of the bounds of the variable ``name``.

    The variable is a number that each ball or contact of the network has, such as a stiffness; a
    load, whose unit depends on the lattice of the ``context``; or a parameter of a sweep.
    """
    _, names_of_numbers = _list_names(context)
    if name in names_of_numbers:
        return _NUMBERS[name]
    if name in LOADS:
        return with_unit(load_quantities(context.lattice.pressed_axes)[name])
    return find_kind(name)


def _read_vary(value: Any, context: Any) -> tuple[tuple[str, tuple[float, float]], ...]:
    """Return the variables as pairs of a name and its bounds (low, high), SI, from a block of
    bounds by name, or from the pairs of another scene. Refused for an unknown name, for a name
    given twice, and for bounds that are not two ascending numbers.
    """
    entries = dict(value) if isinstance(value, tuple) else value
    if not isinstance(entries, Mapping) or not entries:
        raise Refused(show(value), "a block of names and bounds, as {mass: [10 g, 40 g]}")
    varied: dict[str, tuple[float, float]] = {}
    for written, bounds in entries.items():
        name = str(written)
        for prefix in _PREFIXES:
            name = name.removeprefix(prefix)
        rule: Rule = real_number
        if context.written:
            parameters, numbers = _list_names(context)
            names = [*parameters, *numbers]
            if name not in names:
                guess = closest(name, names)
                mend = f"Did you mean {_spell(guess)!r}?" if guess else ""
                allowed = f"one of {', '.join(map(_spell, names))}"
                raise Refused(show(written), allowed, mend, (written,))
            rule = _choose_kind(name, context).rule(context)
        if name in varied:
            raise Refused(f"{name} twice", "each variable once", path=(written,))
        pair = read_inside(written, partial(each, rule=rule, what="bounds"), bounds)
        is_pair = len(pair) == 2 and all(isinstance(end, float) for end in pair)
        if not is_pair or not pair[0] < pair[1]:
            allowed = "the least and the greatest value, [low, high]"
            raise Refused(show(bounds), allowed, path=(written,))
        varied[name] = pair
    return tuple(varied.items())


def _spell(name: str) -> str:
    """Return the ``name`` of a variable as a file has it: a load behind the name of its block."""
    return f"load.{name}" if name in LOADS else name


def _write_vary(varied: Sequence[tuple[str, Any]], context: Any) -> dict[str, Any]:
    """Return the block of the bounds, with units, of the variables by name."""
    return {
        name: [_choose_kind(name, context).write(end, context) for end in bounds]
        for name, bounds in varied
    }


def _read_constraints(value: Any, context: ValueContext) -> tuple[tuple[str, float], ...]:
    """Return the sums that the search keeps, pairs of the name of a number and its sum, SI, from a
    block of sums by name, or from the pairs of another scene.
    """
    entries = dict(value) if isinstance(value, tuple) else value
    return tuple(block_of(_NUMBERS).read(entries, context).items())


class DesignSettings(NetworkSettings):
    """What network is sought; see :func:`granphon.design`."""

    block = "design"

    goal: Any = setting(
        Kind(_read_goal, _write_goal),
        f"`{'`, `'.join(GOALS)}`, with its numbers, see [design](#design)",
    )
    vary: Any = setting(
        Kind(_read_vary, _write_vary),
        "names with bounds, as `{load.force: [1 N, 50 N]}`, see [design](#design)",
    )
    constraints: Any = setting(
        Kind(
            _read_constraints,
            lambda sums, context: block_of(_NUMBERS).write(dict(sums), context) or None,
        ),
        "sums that numbers of the network keep, as `{mass: 56 g}`",
        default=(),
        absent="none",
    )
    per: str = setting(
        word_of(*PER),
        "`each` ball or contact has a variable, or each `kind`, or pair of kinds",
        default=PER[0],
    )
    restarts: int = setting(
        whole_from(0, 100_000), "random starts after the scene's own", default=RESTARTS
    )
    seed: int = setting(whole_from(0), "of these", default=SEED)
    steps: int = setting(whole_from(1, 1_000_000), "most steps of a start", default=STEPS)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the variables."""
        return tuple(name for name, _ in self.vary)

    def make_goal(self) -> Any:
        """Return the goal, an instance of one of the classes that :data:`GOALS` names."""
        name, entries = self.goal
        return _make_goal(name, dict(entries))


# -- the variables of a scene ----------------------------------------------------------------------


def _list_parameters(scene: Any) -> list[str]:
    """Return what may vary of a scene: the kind of its load, and the names of its parameters that
    are numbers; nothing for a packing in files.
    """
    packing = scene.packing
    if packing.medium_name == NetworkMedium.name:
        return []
    all_parameters = getattr(packing, "parameters", ()) or PARAMETERS
    names = [name for name in all_parameters if name not in SPRING_PARAMETERS and find_unit(name)]
    return [scene.load.kind, *names]


def varies_parameters(scene: Any) -> bool:
    """Whether parameters of a scene vary, and not numbers of its network."""
    return not set(scene.design.names).isdisjoint(_list_parameters(scene))


def require_variables(scene: Any) -> None:
    """Raise :class:`~granphon.base.errors.Refused`, with its place in the block, for variables that
    a scene does not have or that do not go together, and for bounds that exclude its own value of a
    parameter.
    """
    settings = scene.design
    parameters = _list_parameters(scene)
    for name, _ in settings.vary:
        if name not in parameters and name not in VARIED:
            allowed = f"one of {', '.join(map(_spell, (*parameters, *VARIED)))}"
            raise Refused(show(name), allowed, path=("design", "vary", name))
    if not varies_parameters(scene):
        return
    numbers = [name for name in settings.names if name not in parameters]
    if numbers:
        first_parameter = next(name for name in settings.names if name in parameters)
        raise Refused(
            f"{numbers[0]} beside {first_parameter}",
            "numbers of the network alone, or parameters of the scene alone",
            "Make a design of each.",
            ("design", "vary", numbers[0]),
        )
    if settings.constraints:
        found = f"a sum of {settings.constraints[0][0]}"
        allowed = "sums of numbers of the network that vary"
        raise Refused(found, allowed, path=("design", "constraints"))
    for name, (low, high) in settings.vary:
        start = _find_start(scene, name)
        if not low <= start <= high:
            unit = find_unit_of_variable(scene, name)
            raise Refused(
                f"{name} from {low:g} to {high:g}",
                f"bounds that hold the value of the scene, {start:g} {unit}",
                path=("design", "vary", name),
            )


def _find_start(scene: Any, name: str) -> float:
    """Return the value, SI, that the parameter ``name`` has in a scene; of several loads, the
    first. Refused if the balls of the scene have no such number.
    """
    if name == scene.load.kind:
        return float(np.ravel(scene.load.array)[0])
    from granphon.observables.parameters import read_number  # other scenes do not need it

    with refusing(name, "parameters of the balls", "design", "vary", name):
        return float(read_number(scene.packing, name))


def find_unit_of_variable(scene: Any, name: str) -> str:
    """Return the SI unit of the variable ``name`` of the design of a scene."""
    if name == scene.load.kind:
        structure = scene.packing.structure
        return find_load_unit(name, structure.periods, structure.pressed_axes)
    if name in _list_parameters(scene):
        return find_unit(name) or ""
    return UNITS[name]
