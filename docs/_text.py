"""The pages of the interface as plain texts, ``docs/reference/api/*.txt``, for readers without a
build of the pages.

Each has the names of its page in their order, with signatures and docstrings; ``python
docs/_generate.py`` writes them.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from textwrap import indent, wrap
from typing import Any

import conf
from _docstrings import INNER, say_types

_HEAD = """{title}

granphon.X is imported from granphon itself, any other name from the module before it. python
docs/_generate.py writes this text from the code.
"""
#: an entry of a page of the interface, with its options
_ENTRY = re.compile(
    r"^\.\. auto(class|function|exception|module):: (\S+)\n((?:   :.*\n)*)", re.MULTILINE
)
#: a link in a docstring: with a text of its own, or of which the last word is shown
_LINK = re.compile(r":\w+:`(?:([^`<]+) <[^`>]+>|~(?:[\w.]*\.)?([\w]+)|([^`]+))`")
#: classes whose members are said once, where they stand themselves
_SAID = frozenset(conf.autodoc_default_options["inherited-members"].split(", "))
#: arrays by their elements, as the pages call them
_ELEMENTS = {"intp": "[int]", "bool_": "[bool]", "complex128": "[complex]"}
#: most letters of a line
_WIDTH = 110


class _Bare(str):
    """A text that a signature shows without quotes."""

    __repr__ = str.__str__


def write_interface(page: Path) -> str:
    """The text of a page of the interface."""
    text = page.read_text(encoding="utf-8")
    parts = [_HEAD.format(title=text.partition("\n")[0].removeprefix("# "))]
    for kind, path, options in _ENTRY.findall(text):
        only = re.findall(r" :members: (.*)", options)
        listed = [""]
        if kind == "module":
            listed = only[0].split(", ") if only else _list_names(path)
        left_out = ", ".join(re.findall(r" :exclude-members: (.*)", options)).split(", ")
        for name in listed:
            parts += _write_entry(f"{path}.{name}".rstrip("."), left_out)
    return "\n".join(parts)


def _list_names(module: str) -> list[str]:
    """Public classes and functions that a module defines."""
    every = vars(import_module(module)).items()
    return [
        name
        for name, one in every
        if callable(one) and one.__module__ == module and not name.startswith("_")
    ]


def _write_entry(path: str, left_out: Sequence[str]) -> Iterator[str]:
    """A function, or a class with its members but those that are ``left_out``."""
    owner, _, name = path.rpartition(".")
    documented = getattr(import_module(owner), name)
    yield _write(path, documented, inspect.getdoc(documented) or "")
    if inspect.isclass(documented):
        for member, value, base in _list_members(documented):
            if member not in left_out:
                docstring = inspect.getdoc(getattr(documented, member)) or ""
                yield indent(_write(f".{member}", value, docstring, base), "    ")


def _list_members(one: type) -> Iterator[tuple[str, Any, type]]:
    """Public methods and properties of a class and of those below the public ones, in the order of
    their source.
    """
    listed = set[str]()
    for base in one.__mro__:
        if base.__module__.startswith("granphon") and (base is one or base.__name__ not in _SAID):
            for name, value in vars(base).items():
                if not (name.startswith("_") or name in INNER | listed) and (
                    callable(value) or hasattr(value, "__get__")
                ):
                    listed.add(name)
                    yield name, value, base


def _write(name: str, one: Any, doc: str, owner: type | None = None) -> str:
    """The signature of a name, and below it its docstring."""
    function = getattr(one, "__func__", one)
    called = name + (_write_signature(function, owner) if callable(function) else "")
    head = "\n".join(
        wrap(
            called,
            _WIDTH,
            subsequent_indent=" " * 8,
            break_long_words=False,
            break_on_hyphens=False,
        )
    )
    said = _LINK.sub(lambda found: found[1] or found[2] or found[3], doc)
    return f"{head}\n{indent(said, '    ')}\n"


def _write_signature(one: Any, owner: type | None) -> str:
    """What a name takes and gives, with types as the pages say them."""
    try:
        signature = inspect.signature(one)
    except ValueError:  # an exception, which takes what Python's own do
        return ""
    parameters = [
        each.replace(
            annotation=each.annotation if each.annotation is each.empty else _Bare(each.annotation),
            default=_say_default(each.default),
        )
        for each in list(signature.parameters.values())[
            owner is not None and not isinstance(one, staticmethod) :
        ]
    ]
    returned = signature.return_annotation
    shown_signature = signature.replace(
        parameters=parameters,
        return_annotation=returned if returned is signature.empty else _Bare(returned),
    )
    words = re.sub(
        r"NDArray\[(?:np\.)?(\w+)\]",
        lambda kind: "Array" + _ELEMENTS.get(kind[1], ""),
        str(shown_signature),
    )
    return say_types(words.replace("<factory>", "..."))


def _say_default(value: Any) -> Any:
    """A default that reads the same in every process: an object without a text of its own by its
    class.
    """
    if inspect.isfunction(value):
        return _Bare(value.__name__)
    return _Bare(f"{type(value).__name__}()") if " at 0x" in repr(value) else value
