"""How the pages of the interface read docstrings and types.

Sections of a docstring become lists of entries, ``name : what it is``. An entry that names a field
    of a class becomes an
attribute of it, with its type, which can be linked and searched for.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, get_origin, get_type_hints

import granphon
from granphon.base import errors

#: a section's title, underlined
_TITLES = ("Parameters", "Attributes", "Returns", "Raises", "Warns", "Notes")
#: one name or several, and the first line of what they are
_ENTRY = re.compile(r"^(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*) : (?P<text>.*)$")
#: a link to a name of the package by the module where it is written
_ROLE = re.compile(r":(?P<role>func|class|meth|attr|exc):`(?P<path>granphon\.[\w.]+)`")
#: names that are imported from granphon itself
_PUBLIC = {
    f"{getattr(granphon, name).__module__}.{name}": name
    for name in granphon.__all__
    if not name.startswith("_")
}
#: what annotations are called on the page; those in capitals without a module are explained there
ALIASES = {
    "Array": "Array",
    "ArrayLike": "ArrayLike",
    "NDArray": "Array",
    "Index": "Array[int]",
    "Flags": "Array[bool]",
    "Complex": "Array[complex]",
    "Values": "Any",
    "Balls": "granphon.Packing | granphon.Arrangement | granphon.NetworkFiles",
    "Law": "granphon.media.state.ContactLaw",
    "SampleLaw": "granphon.media.state.ContactLaw",
    "StateT": "granphon.media.state.ContactState",
    "Compatibility": "granphon.dynamics.contact_lattice.ContactLattice",
    "TrueEquilibrium": "granphon.array.equilibrium.Equilibrium",
    "PressedEquilibrium": "granphon.array.equilibrium.Equilibrium",
    "Equilibrium": "granphon.array.equilibrium.Equilibrium",
    "Plan": "granphon.scene.scene.Scene",
}
#: how elements of arrays other than floats are called
_ELEMENTS = {"int64": "[int]", "bool": "[bool]", "complex128": "[complex]"}
#: public by name, and no part of the interface: what classes of the package ask of each other
INNER = frozenset(
    {
        "options",
        "history",
        "from_source",
        "check_diameter",
        "check_state",
        "cached",
        "reference_lattice",
        "has_one_lattice",
        "velocity_scale",
        "unit_length",
        "overlap_of_equal_balls",
        "branch_scales",
        "prescribed",
        "require",
        "discard_results_on_any_change",
        "implemented_properties",
        "set",
        "units_of",
        "flat",
        "describe",
        "width_units",
        "response",
        "plan",
        "survey",
        "serving",
        "is_exact",
        "operator",
        "parameters_of_branches",
        "to_info",
        "arrays",
        "prepare",
        "slow_part",
        "is_solved_anew",
        "count_start",
        "require_start",
    }
)


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """For ``autodoc-process-docstring``."""
    said = (_ROLE.sub(_say_publicly, line) for line in lines)
    lines[:] = rendered(list(said), field_types(obj) if what == "class" else {})


def _say_publicly(link: re.Match[str]) -> str:
    """A link without the module, which a reader need not know; by the public name if there is
    one.
    """
    owner, _, member = link["path"].rpartition(".")
    if link["path"] in _PUBLIC:
        return f":{link['role']}:`~granphon.{_PUBLIC[link['path']]}`"
    if owner in _PUBLIC:
        return f":{link['role']}:`{_PUBLIC[owner]}.{member} <granphon.{_PUBLIC[owner]}.{member}>`"
    return f":{link['role']}:`~{link['path']}`"


def skip(app: Any, what: str, name: str, obj: Any, skipped: bool, options: Any) -> bool | None:
    """For ``autodoc-skip-member``."""
    return True if what == "class" and name in INNER else None


#: classes whose objects runs make, and nobody else
_MADE_ALONE = {"granphon.RunResult"}


def sign(
    app: Any,
    what: str,
    name: str,
    obj: Any,
    options: Any,
    signature: str | None,
    returned: str | None,
) -> Any:
    """For ``autodoc-process-signature``: names that autodoc could not look up, and defaults made
    anew for each object.
    """
    if name in _MADE_ALONE:
        return "", ""
    return signature and say_types(signature.replace("<factory>", "...")), returned and say_types(
        returned
    )


def name_aliases() -> None:
    """Have autodoc call an alias by its name inside other types too, and arrays by their
    elements.
    """
    from sphinx.util.inspect import TypeAliasForwardRef

    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    TypeAliasForwardRef.__getitem__ = lambda alias, of: TypeAliasForwardRef(  # type: ignore[attr-defined]
        alias.name + _ELEMENTS.get(getattr(of, "__name__", ""), "")
    )


def hide_sources() -> None:
    """Have autodoc take the defaults of readers from their signatures, which are spelled out: their
    sources have not all of them.
    """
    for method in vars(granphon.ContactNetwork).values():
        function = getattr(method, "__func__", None)
        if hasattr(function, "__signature__"):
            function.__wrapped__ = eval("lambda: None")  # which has no source


def field_types(obj: Any) -> dict[str, str]:
    """The type of each field of a dataclass as the page says it; none of another class."""
    from sphinx.util.inspect import TypeAliasForwardRef
    from sphinx.util.typing import stringify_annotation

    if not dataclasses.is_dataclass(obj):
        return {}
    fields = [field.name for field in dataclasses.fields(obj) if not field.name.startswith("_")]
    try:
        hints = get_type_hints(
            obj, None, {name: TypeAliasForwardRef(said) for name, said in ALIASES.items()}
        )
    except NameError:  # imported for type checkers alone
        hints = {
            name: hint
            for one in reversed(obj.__mro__)
            for name, hint in getattr(one, "__annotations__", {}).items()
        }
    return {
        name: say_types(hints[name])
        if isinstance(hints[name], str)
        else stringify_annotation(hints[name], "smart")
        for name in fields
        if get_origin(hints[name]) is not ClassVar and not _stands_apart(obj, name)
    }


def _stands_apart(obj: Any, name: str) -> bool:
    """Whether autodoc lists a field by itself, as a class above it has a property of this name."""
    return any(hasattr(vars(one).get(name), "__get__") for one in obj.__mro__)


def say_types(text: str) -> str:
    """Types as a text of annotations has them, with their aliases said."""
    return re.sub(
        r"(?<![\w.~'])\w+(?!\s*[(\w:=.\[])", lambda name: ALIASES.get(name[0], name[0]), text
    )


def rendered(lines: list[str], fields: Mapping[str, str] = {}) -> list[str]:
    """The lines of a docstring as reStructuredText; ``fields`` are the types of the attributes of
    its class.
    """
    rendered_lines: list[str] = []
    title = ""
    number = 0
    while number < len(lines):
        if (
            lines[number] in _TITLES
            and number + 1 < len(lines)
            and re.fullmatch("-+", lines[number + 1])
        ):
            title = lines[number]
            number = number + 2
            rendered_lines += ["", f":{title}:", ""]
        elif title and lines[number].strip():
            end = next(_ends(lines, number))
            entry = _ENTRY.match(lines[number])
            inner_lines = lines[number + 1 : end]
            if entry:
                rendered_lines += _render_entry(
                    title, entry["names"].split(", "), entry["text"], inner_lines, fields
                )
            elif (
                not lines[number - 1].strip() and title != "Notes"
            ):  # a paragraph after the section
                title = ""
                continue
            else:
                rendered_lines += [f"    {line}" for line in lines[number:end]]
            number = end
        else:
            rendered_lines.append(lines[number])
            number += 1
    return rendered_lines


def _render_entry(
    title: str, names: list[str], text: str, rest: list[str], fields: Mapping[str, str]
) -> list[str]:
    """An entry of a section: an item of a list, or the definition of an attribute."""
    if set(names) <= set(fields):
        types = {fields[name] for name in names}
        made = [
            f"    .. py:attribute:: {names[0]}",
            *(f"                      {name}" for name in names[1:]),
        ]
        made += [f"       :type: {types.pop()}"] if len(types) == 1 else []
        return [*made, "", f"       {text}", *(f"       {line.strip()}" for line in rest), ""]
    shown = [_exception(name) if title in ("Raises", "Warns") else _bold(name) for name in names]
    return [f"    - {', '.join(shown)} – {text}", *(f"      {line.strip()}" for line in rest), ""]


def _ends(lines: list[str], at: int) -> Iterator[int]:
    """Where the entry or the paragraph that begins ``at`` may end."""
    for end in range(at + 1, len(lines)):
        if not lines[end].startswith(" ") and (not lines[end].strip() or _ENTRY.match(lines[end])):
            yield end
    yield len(lines)


def _bold(name: str) -> str:
    return f"**{name.replace('*', chr(92) + '*')}**"


def _exception(name: str) -> str:
    return f":exc:`~granphon.base.errors.{name}`" if hasattr(errors, name) else f":exc:`{name}`"
