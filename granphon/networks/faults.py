"""Balls and contacts of a source that cannot be used, by kinds of fault: all are told at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, message, warn_caller

#: rows of a kind of fault that a message names, the worst ones
_MOST_NAMED = 3
#: what may become of contacts with faults
BAD = ("refuse", "drop")


@dataclass(frozen=True)
class _Kind:
    """A kind of fault: what rows have in words, their number, the worst rows in words, why that is
    a fault, and how to mend it.
    """

    words: str
    count: int
    worst: tuple[str, ...]
    why: str
    mend: str

    def __str__(self) -> str:
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
    rows : (m,) the rows that are looked at; at first all, see :meth:`narrow`.
    is_bad : (count,) whether each row has a fault that has been noted.
    """

    name: str
    subject: str
    count: int
    describe: Callable[[int], str]
    rows: Index = field(init=False)
    is_bad: Flags = field(init=False)
    _kinds: list[_Kind] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rows = np.arange(self.count)
        self.is_bad = np.zeros(self.count, bool)

    def narrow(self, is_kept: Flags | None = None) -> Flags:
        """Look, from now on, only at those of the present rows that are kept (m,) and have no
        fault; return (m,) which these are.
        """
        is_fine = ~self.is_bad[self.rows]
        if is_kept is not None:
            is_fine &= is_kept
        self.rows = self.rows[is_fine]
        return is_fine

    def note(
        self,
        is_bad: Flags,
        words: str,
        *,
        values: Array | None = None,
        unit: str = "",
        why: str = "",
        mend: str = "",
    ) -> None:
        """Note those of the present rows that are bad (m,) and have no other fault: a row counts
        once.

        ``words`` say what these rows have. ``values`` (m,) or (m, d), in the ``unit``, are shown of
        the worst rows, which are those with the largest values, or the first ones.
        """
        places = np.flatnonzero(is_bad & ~self.is_bad[self.rows])
        if not places.size:
            return
        self.is_bad[self.rows[places]] = True
        shown = []
        for place in _find_worst(places, values).tolist():
            value = "" if values is None else f" ({_show(values[place], unit)})"
            shown.append(self.describe(int(self.rows[place])) + value)
        self._kinds.append(_Kind(words, places.size, tuple(shown), why, mend))

    def __str__(self) -> str:
        n_bad = int(np.count_nonzero(self.is_bad))
        head = f"{self.name}: {n_bad} of {self.count} {self.subject} cannot be used"
        return " ".join([f"{head}.", *map(str, self._kinds)])


def settle(lists: Sequence[Faults], drops: bool) -> None:
    """Raise one :class:`~granphon.base.errors.InputError` that tells all faults of balls and
    contacts; with ``drops``, and if all are faults of contacts, warn of them instead: they are
    left out.
    """
    lists_with_faults = [faults for faults in lists if np.any(faults.is_bad)]
    if not lists_with_faults:
        return
    text = " ".join(map(str, lists_with_faults))
    may_drop = all(faults.subject == "contacts" for faults in lists_with_faults)
    if drops and may_drop:
        warn_caller(f"{text} They are left out.", InconsistencyWarning)
        return
    leaves_some = any(not np.all(faults.is_bad) for faults in lists_with_faults)
    mend = ""
    if may_drop and leaves_some:
        mend = "Mend them, or leave them out: bad='drop'"
    raise InputError(text, mend=mend)


def _find_worst(places: Index, values: Array | None) -> Index:
    """Return the few of some ``places`` whose ``values`` are largest, nan first; the first few
    without values.
    """
    if values is None:
        return places[:_MOST_NAMED]
    sizes = np.abs(values[places]).reshape(len(places), -1)
    sizes = np.max(np.where(np.isnan(sizes), np.inf, sizes), axis=1)
    return places[np.argsort(-sizes, kind="stable")[:_MOST_NAMED]]


def _show(value: Array, unit: str) -> str:
    """Return a number or a vector, with its unit, in few digits."""
    numbers = ", ".join(f"{number:.6g}" for number in np.ravel(value).tolist())
    return f"{numbers} {unit}".strip()
