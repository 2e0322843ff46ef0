"""Balls and contacts of a source that cannot be used. They are collected by kinds of fault, so that
one message tells all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, message, warn_caller

#: most rows, balls or contacts of one kind of fault that a message names, the worst ones
MOST_NAMED = 3
#: what a reader does with contacts that have faults: raise an error, or leave them out
FAULT_ACTIONS = ("refuse", "drop")


@dataclass(frozen=True)
class _Kind:
    """A kind of fault.

    Attributes
    ----------
    words : what the rows with this fault have, as "a force that pulls".
    count : number of these rows.
    worst : the worst of them in words, three at most.
    why, mend : why that is a fault, and how to mend it; "" for nothing to say.
    """

    words: str
    count: int
    worst: tuple[str, ...]
    why: str
    mend: str

    def __str__(self) -> str:
        """Return the sentences about this kind of fault in a message."""
        more = "; ..." if self.count > len(self.worst) else ""
        listed = f"{self.count} with {self.words}: {'; '.join(self.worst)}{more}"
        return message(listed, self.why, self.mend)


@dataclass
class Faults:
    """Rows of a source that cannot be used.

    Attributes
    ----------
    name : the source in messages.
    subject : what the rows are: "balls" or "contacts".
    count : number of rows.
    describe : the words that name a row, by its index.
    rows : (m,) indices of the present rows, about which :meth:`note` is told: at first all rows,
        then those that :meth:`narrow` has left.
    is_bad : (count,) whether a fault of each row has been noted.
    """

    name: str
    subject: str
    count: int
    describe: Callable[[int], str]
    rows: Index = field(init=False)
    is_bad: Flags = field(init=False)
    _kinds: list[_Kind] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin with all rows present, and none of them bad."""
        self.rows = np.arange(self.count)
        self.is_bad = np.zeros(self.count, bool)

    def narrow(self, is_kept: Flags | None = None) -> Flags:
        """Reduce the present ``rows`` to those that have no fault and that ``is_kept`` (m,) marks,
        by default all; return (m,) truth values of the rows before, true for those that are left.
        """
        is_fine = ~self.is_bad[self.rows]
        if is_kept is not None:
            is_fine &= is_kept
        self.rows = self.rows[is_fine]
        return is_fine

    def note(
        self,
        has_fault: Flags,
        words: str,
        *,
        values: Array | None = None,
        unit: str = "",
        why: str = "",
        mend: str = "",
    ) -> None:
        """Note a fault of the present rows that ``has_fault`` (m,) marks; a row that already has a
        fault is not noted again.

        ``words`` say what these rows have, ``why`` and ``mend`` are those of the message. The
        message shows the ``values`` (m,) or (m, d), in the ``unit``, of the worst rows, three at
        most: those whose values, or largest components, are greatest in magnitude; nan counts as
        infinite. Without values the message names the first rows.
        """
        places = np.flatnonzero(has_fault & ~self.is_bad[self.rows])
        if not places.size:
            return
        self.is_bad[self.rows[places]] = True
        shown = []
        for place in _find_worst(places, values).tolist():
            value = "" if values is None else f" ({_show(values[place], unit)})"
            shown.append(self.describe(int(self.rows[place])) + value)
        self._kinds.append(_Kind(words, places.size, tuple(shown), why, mend))

    def __str__(self) -> str:
        """Return the message about all rows with faults, kind by kind."""
        n_bad = int(np.count_nonzero(self.is_bad))
        head = f"{self.name}: {n_bad} of {self.count} {self.subject} cannot be used"
        return " ".join([f"{head}.", *map(str, self._kinds)])


def settle(lists: Sequence[Faults], drops: bool) -> None:
    """Raise one :class:`~granphon.base.errors.InputError` that tells all faults in ``lists``, of
    balls and of contacts; do nothing if there is none.

    With ``drops``, if all are faults of contacts, warn instead that these contacts are left out;
    the caller leaves them out.
    """
    lists_with_faults = [faults for faults in lists if np.any(faults.is_bad)]
    if not lists_with_faults:
        return
    text = " ".join(map(str, lists_with_faults))
    may_drop = all(faults.subject == "contacts" for faults in lists_with_faults)
    if drops and may_drop:
        warn_caller(f"{text} They are left out.", InconsistencyWarning)
        return
    # a list of walls may have no fault where all pairs have one
    leaves_some = any(
        faults.subject == "contacts" and not np.all(faults.is_bad) for faults in lists
    )
    mend = ""
    if may_drop and leaves_some:
        mend = "Mend them, or leave them out: bad='drop'"
    raise InputError(text, mend=mend)


def _find_worst(places: Index, values: Array | None) -> Index:
    """Return those of the ``places`` (m,), three at most, at which ``values``, an array with a
    number or a row of components at each place, is largest in magnitude, by its largest component;
    nan counts as infinite. Without values these are the first three.
    """
    if values is None:
        return places[:MOST_NAMED]
    sizes = np.abs(values[places]).reshape(len(places), -1)
    sizes = np.max(np.where(np.isnan(sizes), np.inf, sizes), axis=1)
    return places[np.argsort(-sizes, kind="stable")[:MOST_NAMED]]


def _show(value: Array, unit: str) -> str:
    """Return a number, or the components of a vector, with six digits and the unit, as text."""
    numbers = ", ".join(f"{number:.6g}" for number in np.ravel(value).tolist())
    return f"{numbers} {unit}".strip()
