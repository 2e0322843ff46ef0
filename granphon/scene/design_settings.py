"""The settings of the design of a scene: the goal, what varies, and the bounds.

What varies are parameters of the scene, as a sweep names them, and its load; or numbers of the
balls and contacts of its network. The goals of granphon are imported when a goal is made, as they
need phonons, and other scenes do not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import partial
from numbers import Real
from typing import Any, NamedTuple, cast

import numpy as np

from granphon.balls.on_site import SPRING_PARAMETERS
from granphon.balls.packing import PARAMETERS, find_unit
from granphon.base.errors import Refused
from granphon.base.quantities import (
    FREQUENCY,
    LOADS,
    NUMBER,
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

#: the kind of each number of a network that may vary, by name
_NUMBERS = {name: with_unit(quantity) for name, quantity in QUANTITIES.items()}
#: a name of a variable behind that of its block, which may be left out, as in load.force
_NAME_IN_BLOCK = re.compile(r"(?:load|material|packing)\.(.+)")
#: most points of the mesh of a gap along each period, far above the 48 of the default
_MOST_POINTS = 1000
#: largest component of a wave vector, in fractions of the reciprocal cell: that of a zone far away
#: is a mistake
_LARGEST_COMPONENT = 1e3
#: greatest number of a branch in a list, above that of any network whose branches can be found
_MOST_BRANCHES = 1_000_000


# -- the goal --------------------------------------------------------------------------------------


def _make_frequencies_kind(column: str) -> Kind:
    """Return the kind of several frequencies, Hz: a list, or in a file the name of a table, whose
    ``column`` has the frequencies. Tables are sought in the folder of the scene.
    """
    list_kind = listed(with_unit(FREQUENCY), "frequencies")

    def read(value: Any, context: ValueContext) -> tuple[float, ...]:
        """Return the frequencies (n,), Hz, of a list or of the table that a text names. Refused
        where the table cannot be read, and in Python for a text.
        """
        if not (isinstance(value, str) and context.written):
            return list_kind.read(value, context)  # type: ignore[no-any-return]
        with refusing(value, f"a list, as [6.5 kHz], or a table with a column {column}"):
            table = Table.read(context.folder / value, quoted=False)
            return tuple(table.column(column, FREQUENCY).tolist())

    return Kind(read, list_kind.write, FREQUENCY.unit)


def _is_quantity(value: Any) -> bool:
    """Return whether a ``value`` is a number or a text that begins with one, "1 Hz": it names no
    table.
    """
    if isinstance(value, str):
        return re.match(rf"\s*{NUMBER}", value) is not None
    return isinstance(value, Real)


def _read_sigma(value: Any, context: ValueContext) -> float | tuple[float, ...]:
    """Return one standard error, Hz, from a quantity, or several, (n,) Hz, from a list or the name
    of a table. A text that begins with a number is a quantity.
    """
    kind = with_unit(FREQUENCY) if _is_quantity(value) else _make_frequencies_kind("sigma")
    sigma: float | tuple[float, ...] = kind.read(value, context)
    return sigma


def _write_sigma(sigma: Any, context: ValueContext) -> Any:
    """Return plain data for one standard error, Hz, or for a tuple of standard errors."""
    kind = _make_frequencies_kind("sigma") if isinstance(sigma, tuple) else with_unit(FREQUENCY)
    return kind.write(sigma, context)


def _read_qpoints(value: Any) -> tuple[tuple[float, ...], ...]:
    """Return wave vectors, (n_q, p) in fractions of the reciprocal cell, from a list in which each
    wave vector is a text such as "1/3 1/3", a list of numbers, or on a chain a number. Refused for
    components that are no numbers up to :data:`_LARGEST_COMPONENT` in magnitude; whether there are
    p of them the goal judges, which knows the network.
    """

    def read_point(point: Any) -> tuple[float, ...]:
        """Return the components (p,) of one wave vector."""
        words: Any = point.split() if isinstance(point, str) else point
        if not isinstance(words, list | tuple):
            words = [words]
        return each(words, partial(fraction, largest=_LARGEST_COMPONENT), "numbers")

    return each(value, read_point, "wave vectors")


class _Form(NamedTuple):
    """The form of a goal in a file.

    Attributes
    ----------
    class_name : the class of the goal, a public name of granphon.
    keys : the kinds of the goal's numbers, by their keys, which are the arguments of the class.
    needed : the keys that a file must give.
    """

    class_name: str
    keys: Mapping[str, Kind]
    needed: tuple[str, ...] = ()


#: the kinds of the settings of a response that a goal has too: a design has one frequency, and it
#: repeats and cuts the network itself
_RESPONSE_KINDS = {
    name: declared.kind
    for name, declared in list_settings(ResponseSettings).items()
    if name not in ("frequencies", "repeat", "cut")
}
#: the kind of a list of numbers of branches, from 0
_BRANCHES = Kind.plain(lambda value: read_counts(value, "numbers", 0, _MOST_BRANCHES), list)
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
            "measured": _make_frequencies_kind("frequency"),
            "sigma": Kind(_read_sigma, _write_sigma),
            "q": Kind.plain(_read_qpoints, lambda points: [list(point) for point in points]),
            "branches": _BRANCHES,
        },
        ("measured",),
    ),
    "lowest_velocity": _Form("LowestVelocity", {"direction": DIRECTION, "wave": whole_from(0)}),
    "response_at": _Form(
        "ResponseAt",
        {"frequency": with_unit(FREQUENCY), "largest": Kind.plain(truth), **_RESPONSE_KINDS},
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
    numbers: Any = None
    if isinstance(value, tuple) and len(value) == 2:
        name = value[0]
        numbers = _join_pairs(value[1])
    elif isinstance(value, Mapping) and len(value) == 1:
        ((name, numbers),) = value.items()
    if not isinstance(name, str):
        allowed = f"one of {', '.join(GOALS)}, with its numbers, as {{widest_gap: {{near: 5 kHz}}}}"
        raise Refused(show(value), allowed)
    form = GOALS[choice(name, tuple(GOALS))]
    rule = block_of(form.keys, form.needed).rule(context)
    # all numbers may be commented out below the name
    entries = read_inside(name, rule, {} if numbers is None else numbers)
    with refusing(numbers or name, f"numbers of the goal {name}", name):
        _make_goal(name, entries)  # made here only to check the numbers
    return name, tuple(entries.items())


def _join_pairs(value: Any) -> Any:
    """Return the mapping that a tuple of pairs stands for, as settings keep the entries of a block;
    any other ``value`` as it is, which the rule of a block refuses unless it is a mapping.
    """
    are_pairs = isinstance(value, tuple) and all(
        isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], str) for pair in value
    )
    return dict(value) if are_pairs else value


def _write_goal(goal: tuple[str, Any], context: ValueContext) -> Any:
    """Return the name of a goal without numbers, or else the block of its numbers under the name.

    The ``goal`` is the pair that :func:`_read_goal` returns.
    """
    name, entries = goal
    return {name: block_of(GOALS[name].keys).write(dict(entries), context)} if entries else name


def _make_goal(name: str, entries: Mapping[str, Any]) -> Any:
    """Return the goal called ``name`` in a file, an instance of its class, with the numbers
    ``entries`` by key; sources and receivers, which are words in a file, become places. InputError
    for numbers that the goal does not accept.
    """
    import granphon

    arguments = dict(entries)
    for key in ("source", "receiver"):
        if key in arguments:
            arguments[key] = [find_place(words) for words in arguments[key]]
    return getattr(granphon, GOALS[name].class_name)(**arguments)


def named_tables_of_goal(goal: Any) -> list[str]:
    """Return the names of the tables of frequencies that the ``goal`` of a valid scene file, plain
    data, refers to.
    """
    numbers = goal.get("match_frequencies", {}) if isinstance(goal, Mapping) else {}
    measured = numbers.get("measured")
    sigma = numbers.get("sigma")
    # a standard error may be a quantity
    names = [measured] if _is_quantity(sigma) else [measured, sigma]
    return [name for name in names if isinstance(name, str)]


# -- what varies -----------------------------------------------------------------------------------


def _list_numbers(parameters: Sequence[str]) -> list[str]:
    """Return the names of those ``parameters`` of a scene that are numbers. Without ``parameters``,
    as the context of a packing has none, they are those of a packing. Springs to the ground are
    left out, which vary as numbers of the network.
    """
    names = parameters or tuple(PARAMETERS)
    return [name for name in names if name not in SPRING_PARAMETERS and find_unit(name) is not None]


def _list_names(context: Any) -> tuple[list[str], list[str]]:
    """Return two lists of names that may vary: the kinds of load and the parameters of the scene
    that are numbers; and the numbers of its network, without those that are parameters too. The
    ``context`` is that of a scene, or that of settings in Python, which has no parameters.
    """
    parameters = _list_numbers(getattr(context, "parameters", ()))
    return [*LOADS, *parameters], [name for name in _NUMBERS if name not in parameters]


def _choose_kind(name: str, context: Any) -> Kind:
    """Return the kind of each bound of the variable ``name``: a number that each ball or contact of
    the network has, such as a stiffness; a load, whose unit depends on the lattice of the
    ``context`` of the scene; or a parameter of a sweep.
    """
    _, names_of_numbers = _list_names(context)
    if name in names_of_numbers:
        return _NUMBERS[name]
    if name in LOADS:
        return with_unit(load_quantities(context.lattice.pressed_axes)[name])
    return find_kind(name)


def _read_vary(value: Any, context: Any) -> tuple[tuple[str, tuple[float, float]], ...]:
    """Return the variables as pairs of a name and its bounds (low, high), SI, from a block of
    bounds by name, or from the pairs of another scene. A name may stand behind that of its block.

    Refused for a name given twice, for bounds that are not two finite, ascending numbers, and in a
    file for an unknown name; :func:`require_variables` refuses one in Python.
    """
    entries = _join_pairs(value)
    if not isinstance(entries, Mapping) or not entries:
        raise Refused(show(value), "a block of names and bounds, as {mass: [10 g, 40 g]}")
    varied: dict[str, tuple[float, float]] = {}
    for written, bounds in entries.items():
        name = _NAME_IN_BLOCK.sub(r"\1", str(written))
        rule: Rule = real_number
        if context.written:
            _require_known_variable(name, written, context)
            rule = _choose_kind(name, context).rule(context)
        if name in varied:
            raise Refused(f"{name} twice", "each variable once", path=(written,))
        varied[name] = read_inside(written, partial(_read_bounds, rule=rule), bounds)
    return tuple(varied.items())


def _require_known_variable(name: str, written: Any, context: Any) -> None:
    """Raise Refused, at the key ``written``, unless a scene of the ``context`` may have the
    variable ``name``.
    """
    parameters, numbers = _list_names(context)
    names = [*parameters, *numbers]
    if name not in names:
        guess = closest(name, names)
        mend = f"Did you mean {_spell_variable(guess)!r}?" if guess else ""
        raise Refused(show(written), _spell_allowed(names), mend, (written,))


def _read_bounds(value: Any, rule: Rule) -> tuple[float, float]:
    """Return the least and the greatest value of a variable from a list of the two, each read by
    the ``rule``; Refused unless these are two finite, ascending numbers.
    """
    bounds = each(value, rule, "bounds")
    # a parameter may have a word for a value, as torsion has
    are_finite = all(isinstance(bound, float) and math.isfinite(bound) for bound in bounds)
    if len(bounds) != 2 or not are_finite or not bounds[0] < bounds[1]:
        raise Refused(show(value), "the least and the greatest value, both finite, [low, high]")
    return bounds


def _spell_variable(name: str) -> str:
    """Return the ``name`` of a variable as a file has it: a load behind the name of its block."""
    return f"load.{name}" if name in LOADS else name


def _spell_allowed(names: Sequence[str]) -> str:
    """Return words for a message: one of the variables ``names``, each once."""
    return f"one of {', '.join(map(_spell_variable, dict.fromkeys(names)))}"


def _write_vary(varied: Sequence[tuple[str, Any]], context: Any) -> dict[str, Any]:
    """Return the block of the bounds, with units, of the variables by name."""
    return {
        name: [_choose_kind(name, context).write(end, context) for end in bounds]
        for name, bounds in varied
    }


def _read_constraints(value: Any, context: ValueContext) -> tuple[tuple[str, float], ...]:
    """Return the sums that the search keeps, pairs of the name of a number and its sum, SI, from a
    block of sums by name, or from the pairs of another scene. Refused for an unknown name, and for
    a sum that is no value of the number.
    """
    return tuple(block_of(_NUMBERS).read(_join_pairs(value), context).items())


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
    """Return what may vary of a scene beside numbers of its network: the kind of its load, unless
    the load is a tensor, and the names of its parameters that are numbers; nothing for a packing in
    files.
    """
    packing = scene.packing
    if packing.medium_name == NetworkMedium.name:
        return []
    kinds_of_load = [kind for kind in LOADS if kind == scene.load.kind]
    return [*kinds_of_load, *_list_numbers(getattr(packing, "parameters", ()))]


def varies_parameters(scene: Any) -> bool:
    """Return whether parameters of a ``scene`` vary in its design; otherwise numbers of its network
    do.
    """
    return not set(scene.design.names).isdisjoint(_list_parameters(scene))


def require_variables(scene: Any) -> None:
    """Raise :class:`~granphon.base.errors.Refused`, with its place in the block, for variables that
    a scene does not have or that do not go together, for sums of parameters, and for bounds that
    exclude its own value of a parameter.
    """
    settings = scene.design
    parameters = _list_parameters(scene)
    allowed_names = [*parameters, *VARIED]
    for name in settings.names:
        if name not in allowed_names:
            path = ("design", "vary", name)
            raise Refused(show(name), _spell_allowed(allowed_names), path=path)
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
    _require_starts(scene)


def _require_starts(scene: Any) -> None:
    """Raise :class:`~granphon.base.errors.Refused` for bounds that exclude the value that a scene
    itself has for a parameter that varies; the search begins there.
    """
    for name, (low, high) in scene.design.vary:
        start = _find_start(scene, name)
        if not low <= start <= high:
            unit = find_unit_of_variable(scene, name)
            raise Refused(
                f"{name} from {low:g} to {high:g}",
                f"bounds that hold the value of the scene, {start:g} {unit}",
                path=("design", "vary", name),
            )


def _find_start(scene: Any, name: str) -> float:
    """Return the value, SI, that the parameter or load ``name`` has in a scene; of several loads,
    the first. Refused if the balls of the scene have no such number, as where torsion is a word.
    """
    if name == scene.load.kind:
        return float(np.ravel(scene.load.array)[0])
    from granphon.observables.parameters import read_number  # other scenes do not need it

    with refusing(name, "parameters of the balls", "design", "vary", name):
        return float(read_number(scene.packing, name))


def find_unit_of_variable(scene: Any, name: str) -> str:
    """Return the SI unit of the variable ``name`` of the design of a scene, "1" for a pure
    number.
    """
    if name == scene.load.kind:
        structure = scene.packing.structure
        return find_load_unit(name, structure.periods, structure.pressed_axes)
    if name in _list_parameters(scene):
        return cast("str", find_unit(name))
    return UNITS[name]
