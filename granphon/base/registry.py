"""Tables of what has a name: lattices, contact laws, media, observables and readers of files, which
plug-ins add to.

Each table is a :class:`Registry`. A package that adds entries, a plug-in, names a function in its
entry points of the group ``granphon.plugins``, which calls ``granphon.register_...``; or it names a
module, which does so when it is imported. Plug-ins are loaded when a table is asked for a name that
it does not have, or for all of its names: until then they cost nothing. A plug-in that fails adds
nothing, and errors about unknown names say which plug-in failed, and why.
"""

from __future__ import annotations

import threading
from collections.abc import ItemsView, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from granphon.base.errors import InputError, one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
#: group of the entry points
GROUP = "granphon.plugins"
#: who adds an entry that is not granphon's own, in words, if no plug-in does
_PROGRAM = "the program"


@dataclass(frozen=True)
class Later:
    """An entry of granphon whose module is imported when the entry is first asked for.

    Attributes
    ----------
    module, attribute : name of the module, and of the entry in it.
    """

    module: str
    attribute: str

    def load(self) -> Any:
        """Import the module, and return the entry."""
        return getattr(import_module(self.module), self.attribute)


class Registry(Mapping[str, T]):
    """The entries of one kind by their names, in the order in which they were added; ``noun`` is
    the kind in words, such as "observable".
    """

    #: every registry, by its kind
    every: dict[str, Registry[Any]] = {}

    def __init__(self, noun: str) -> None:
        """Make an empty table, and enter the table into ``Registry.every``."""
        self.noun = noun
        self._entries = dict[str, T]()
        #: the entries of granphon that have not been imported yet
        self._later = dict[str, Later]()
        #: who has added each entry that is not granphon's own, in words
        self._sources = dict[str, str]()
        #: the identity, by :func:`_identify`, of each entry that is not granphon's own
        self._identities = dict[str, Any]()
        self.every[noun] = self

    def own(self, name: str, entry: T | Later) -> None:
        """Add an entry of granphon itself, in place of a former entry of this ``name``."""
        entries: dict[str, Any] = self._entries  # where a Later keeps the place of its entry
        entries[name] = entry
        for notes in (self._later, self._sources, self._identities):  # on a former entry
            notes.pop(name, None)
        if isinstance(entry, Later):
            self._later[name] = entry

    def _import(self, *names: str) -> None:
        """Import the modules of those entries called ``names`` that have not been imported yet."""
        for name in names:
            later = self._later.get(name)
            if later is not None:
                self._entries[name] = later.load()
                self._later.pop(name, None)  # another thread may have taken it out meanwhile

    def add(self, name: str, entry: T, made: Any) -> T:
        """Add an entry, and return it; ``made`` is the function, class or object of the caller that
        the entry is made from.

        The same object may be added again, and takes the place of the former: an equal object, or a
        function or class defined anew under its own name in the same module, as by a cell of a
        notebook that runs twice. Raises :class:`~granphon.base.errors.InputError` if there is
        another entry of this name, or the same one of another plug-in, or if the name is none that
        tables can show.
        """
        # imported here, so that a command that only lists the plug-ins loads no NumPy
        from granphon.base.validation import label, require

        require(f"the name of a {self.noun}", label, name)
        source = getattr(_plugins, "loading", "") or _PROGRAM
        identity = _identify(made)
        if name in self._entries and not self._has_same(name, source, identity):
            holder = self._sources.get(name, "granphon")
            raise InputError(
                f"the {self.noun} {name!r} exists already, of {holder}", mend="Give another name"
            )
        self._entries[name] = entry
        self._sources[name] = source
        self._identities[name] = identity
        return entry

    def _has_same(self, name: str, source: str, identity: Any) -> bool:
        """Whether the entry of a name was added by the same ``source`` from the same object."""
        if self._sources.get(name) != source:
            return False
        try:
            return bool(self._identities[name] == identity)
        except ValueError:  # objects that hold arrays cannot be compared
            return False

    def remove(self, name: str) -> None:
        """Take out the added entry of a name; without an effect if none of this name was added."""
        if self.is_added(name):
            self._take_out(name)

    def _take_out(self, name: str) -> None:
        """Take out an entry that was added, and what is noted of it."""
        del self._entries[name], self._sources[name], self._identities[name]

    def peek(self, name: str) -> T | None:
        """Return the entry of a name, None if there is none so far: plug-ins are not loaded, but a
        module of granphon that holds the entry is imported.
        """
        self._import(name)
        return self._entries.get(name)

    def is_added(self, name: str) -> bool:
        """Whether there is an entry of a name that is not granphon's own."""
        return name in self._sources

    @property
    def added(self) -> dict[str, T]:
        """The entries that are not granphon's own, by name, as they are now; plug-ins are loaded
        first.
        """
        load_plugins()
        return {name: self._entries[name] for name in self._sources}

    def describe(self, name: str) -> str:
        """Return the entry of a name in words, with the plug-in that has added the entry, if one
        has: "the observable 'impedance' of the plug-in x".
        """
        source = self._sources.get(name, _PROGRAM)
        words = f"the {self.noun} {name!r}"
        return words if source == _PROGRAM else f"{words} of {source}"

    @staticmethod
    def describe_failures() -> str:
        """Return the plug-ins that failed, and why, in a sentence for the error about a name that a
        table does not have, as one of them may have the name; empty if no plug-in failed. Plug-ins
        are loaded first.
        """
        clauses = []
        for plugin, why in load_plugins().items():
            if why:
                clauses.append(f"{plugin} could not be loaded: {one_line(why)}")
        sentence = "; ".join(clauses)
        return sentence[:1].upper() + sentence[1:]

    def drop(self, source: str) -> None:
        """Take out all entries that the plug-in ``source``, in words, has added."""
        names = [name for name, origin in self._sources.items() if origin == source]
        for name in names:
            self._take_out(name)

    def __getitem__(self, name: str) -> T:
        """Return the entry of a name; KeyError if there is none. Plug-ins are loaded for a name
        that is not there, and a module that has not been imported yet is imported.
        """
        if name not in self._entries:
            load_plugins()
        if name in self._later:
            self._import(name)
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names as they are now; plug-ins are loaded first."""
        load_plugins()
        # a copy, as entries may be added or taken out while a loop runs
        return iter(tuple(self._entries))

    def __len__(self) -> int:
        """Return the number of entries; plug-ins are loaded first."""
        load_plugins()
        return len(self._entries)

    def items(self) -> ItemsView[str, T]:
        """Return names and entries as they are now; plug-ins are loaded first, and the modules of
        all entries are imported.
        """
        load_plugins()
        self._import(*self._later)
        return dict(self._entries).items()


def _identify(made: Any) -> Any:
    """Return what identifies an object, and is equal where the object is defined twice: module and
    name of a function or class, and of a method also what identifies its object; code, closure and
    defaults of a lambda or local function; or else the object itself.
    """
    name = getattr(made, "__qualname__", None)
    if name is not None and "<" not in name:  # "<lambda>", "<locals>" are no names
        owner = getattr(made, "__self__", None)
        return made.__module__, name, None if owner is None else _identify(owner)
    code = getattr(made, "__code__", None)
    if code is None:
        return made
    defaults = made.__defaults__, made.__kwdefaults__
    return code.co_code, code.co_consts, code.co_names, made.__closure__, defaults


#: its attribute ``loading`` names the plug-in that a thread is loading; empty or absent otherwise
_plugins = threading.local()
_lock = threading.RLock()
#: why each plug-in that was loaded has failed, by the plug-in in words; None if it has not failed
_loaded: dict[str, str | None] = {}


def load_plugins() -> dict[str, str | None]:
    """Load the plug-ins that are installed, once in a process.

    Returns for each plug-in, in words, why it failed, or None if it did not fail.
    """
    with _lock:
        if not _loaded:
            # an entry that is no plug-in, set first: a plug-in that asks for a name while it loads
            # must not load all again, nor must a process without plug-ins
            _loaded["granphon"] = None
            from importlib.metadata import entry_points  # here, as this import takes 30 ms

            for point in entry_points(group=GROUP):
                _load_plugin(point)
        return {name: why for name, why in _loaded.items() if name != "granphon"}


def _load_plugin(point: EntryPoint) -> None:
    """Load one plug-in, and call it if it can be called, as a function; note in ``_loaded`` why it
    failed, and take out its entries then.
    """
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


def list_added(noun: str) -> tuple[str, ...]:
    """Return the sorted names that plug-ins and the program have added to the registry of a kind,
    its ``noun``; none where the module of that registry has not been imported. Plug-ins are loaded
    first.
    """
    load_plugins()
    if noun not in Registry.every:
        return ()
    return tuple(sorted(Registry.every[noun]._sources))
