"""Tables of what has a name: lattices, contact laws, media, observables and readers of files, which
plug-ins add to.

Each table is a :class:`Registry`. granphon's own entries come into it by the same call as those of
others. A package that adds some names a function in its entry points of the group
``granphon.plugins``, which calls ``granphon.register_...``; a module will do, which does so when it
is imported. Plug-ins are loaded when a table is asked for a name that it does not have, or for all
that it has: what does not ask pays nothing. One that fails adds nothing, and errors about unknown
names say which and why.
"""

from __future__ import annotations

import threading
from collections.abc import ItemsView, Iterator, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from granphon.base.errors import InputError, one_line

T = TypeVar("T")
#: group of the entry points
GROUP = "granphon.plugins"
#: who adds an entry that is not granphon's own, if it is no plug-in
_PROGRAM = "the program"


class Registry(Mapping[str, T]):
    """What is known of one kind by its name, in the order in which it was added; ``what`` is the
    kind in words.
    """

    #: every registry, by its kind
    every: dict[str, Registry[Any]] = {}

    def __init__(self, what: str) -> None:
        self.what = what
        self._entries = dict[str, T]()
        #: who has added each entry that is not granphon's own
        self._sources = dict[str, str]()
        self._made = dict[str, Any]()
        self.every[what] = self

    def own(self, name: str, entry: T) -> T:
        """Add an entry of granphon, and return it."""
        self._entries[name] = entry
        return entry

    def add(self, name: str, entry: T, made: Any) -> T:
        """Add an entry, and return it; ``made`` is the function, class or object that someone gave
        for it.

        The same may be added again: an equal object, or a function or class defined anew under its
        own name in the same module, as by a cell of a notebook that runs twice. It takes the place
        of the former. Raises
        :class:`~granphon.base.errors.InputError` if another of this name is there.
        """
        # imported here: what only lists the plug-ins needs no NumPy
        from granphon.base.validation import label, require

        require(f"the name of a {self.what}", label, name)
        source = getattr(_plugins, "loading", "") or _PROGRAM
        name_of_object = _identify(made)
        again = False  # whether the entry is the same as one that is there
        holder = self._sources.get(name, "granphon" if name in self._entries else None)
        with suppress(ValueError):  # of objects that hold arrays
            again = holder == source and bool(self._made[name] == name_of_object)
        if holder is not None and not again:
            raise InputError(
                f"the {self.what} {name!r} exists already, of {holder}", mend="Give another name"
            )
        self._entries[name] = entry
        self._sources[name] = source
        self._made[name] = name_of_object
        return entry

    def remove(self, name: str) -> None:
        """Take out an entry that was added; nothing if there is none of this name."""
        if self.is_added(name):
            del self._entries[name], self._sources[name]

    def peek(self, name: str) -> T | None:
        """Return the entry of a name if it is there by now: nothing is loaded for it."""
        return self._entries.get(name)

    def is_added(self, name: str) -> bool:
        """Whether an entry is there that is not granphon's own."""
        return name in self._sources

    def describe(self, name: str) -> str:
        """Return an entry in words, with the plug-in that has added it: "the observable 'impedance'
        of the plug-in x".
        """
        source = self._sources.get(name, _PROGRAM)
        words = f"the {self.what} {name!r}"
        return words if source == _PROGRAM else f"{words} of {source}"

    @property
    def failures(self) -> str:
        """A sentence on plug-ins that failed, one of which may have what is not found here; empty
        if none has.
        """
        sentence = "; ".join(
            f"{name} could not be loaded: {one_line(why)}"
            for name, why in load_plugins().items()
            if why
        )
        return sentence[:1].upper() + sentence[1:]

    def drop(self, source: str) -> None:
        """Take out all entries of a plug-in."""
        names = [name for name, origin in self._sources.items() if origin == source]
        for name in names:
            del self._entries[name], self._sources[name]

    def __getitem__(self, name: str) -> T:
        if name not in self._entries:
            load_plugins()
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        load_plugins()
        return iter(tuple(self._entries))

    def __len__(self) -> int:
        load_plugins()
        return len(self._entries)

    def items(self) -> ItemsView[str, T]:
        """Return names and entries as they are now."""
        load_plugins()
        return dict(self._entries).items()


def _identify(made: Any) -> Any:
    """Return what is equal for the same: a function's or class's name and module, a lambda's code,
    or itself.
    """
    name = getattr(made, "__qualname__", None)
    if name is not None and "<" not in name:
        return made.__module__, name
    code = getattr(made, "__code__", None)
    if code is None:
        return made
    return code.co_code, code.co_consts, code.co_names, made.__closure__


#: what is loading, in each thread
_plugins = threading.local()
_lock = threading.RLock()
#: plug-ins that were loaded, each with why it failed; None where it did not, or has not ended
_loaded: dict[str, str | None] = {}


def load_plugins() -> dict[str, str | None]:
    """Load the plug-ins that are installed, once; return them in words, each with why it failed, or
    None.
    """
    with _lock:
        if not _loaded:
            _loaded["granphon"] = None  # a plug-in that asks for names meets those that are there
            from importlib.metadata import entry_points  # which takes 30 ms

            for point in entry_points(group=GROUP):
                source = f"the plug-in {point.name}"
                if point.dist:
                    source += f" of {point.dist.name}"
                _plugins.loading = source
                _loaded[source] = None
                try:
                    plugin = point.load()
                    if callable(plugin):
                        plugin()
                except Exception as error:
                    _loaded[source] = f"{type(error).__name__}: {error}"
                    for registry in Registry.every.values():
                        registry.drop(source)
                finally:
                    _plugins.loading = ""
        return {name: why for name, why in _loaded.items() if name != "granphon"}


def list_added(what: str) -> tuple[str, ...]:
    """Return the names of a kind that plug-ins and the program have added; none where nothing has
    asked for the kind yet.
    """
    load_plugins()
    return tuple(sorted(Registry.every[what]._sources)) if what in Registry.every else ()
