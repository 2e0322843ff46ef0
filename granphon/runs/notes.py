"""Warnings of a sweep: one for each limit that is passed, with the worst value, the number of
states beyond the limit, and where these states lie.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.quantities import find_load_unit
from granphon.base.scales import write_in
from granphon.media.limits import Check
from granphon.runs.tasks import Case

#: greatest number of values of a parameter that a warning lists
_MOST_VALUES = 3


@dataclass(frozen=True, eq=False)
class CaseNotes:
    """The notes on a case, from which warnings are made: conditions over its loads, and sentences.

    Attributes
    ----------
    case : the case.
    notes : the conditions and the sentences.
    loads : the indices of the loads to which the values of a condition belong; None for those of
        the case, in their order.
    """

    case: Case
    notes: Sequence[Check | str]
    loads: NDArray[np.intp] | None = None

    @classmethod
    def of(cls, case: Case, notes: Sequence[Check | str]) -> CaseNotes:
        """Return notes on a whole case; the values of their conditions are those of one medium of
        the case after the other.
        """
        return cls(case, notes, np.concatenate([medium.serving.loads for medium in case.media]))

    @property
    def has_states(self) -> bool:
        """Whether the notes are about any state."""
        return self.loads is None or self.loads.size > 0

    @property
    def n_loads(self) -> int:
        """Number of loads of the case."""
        return self.case.load.size

    @property
    def values(self) -> dict[str, str]:
        """The medium and the swept parameters of the case, as texts by name."""
        return {"medium": self.case.medium.label, **dict(self.case.values)}

    def find_failing(self, check: Check) -> NDArray[np.intp] | None:
        """Return the indices, ascending, of the loads at which the condition ``check`` fails; None
        where the condition has another number of values than there are loads, so that it is not
        known to which loads the values belong.
        """
        is_failing = ~np.ravel(check.ok)
        order = np.arange(self.n_loads) if self.loads is None else self.loads
        if is_failing.size != order.size:
            return None
        return np.sort(order[is_failing])


def tell_notes(entries: Sequence[CaseNotes]) -> list[str]:
    """Return the warnings of all cases of a sweep from the ``entries``, of which a case may have
    several.

    If all entries are about one case, each condition that fails and each sentence is a warning,
    which does not name the case. Otherwise there is one warning for each limit that cases pass, and
    one for each sentence, with the cases that it is about, in the order in which they come first.
    """
    if len({entry.case.label for entry in entries}) == 1:
        texts = [text for entry in entries for text in _tell_case(entry)]
        return list(dict.fromkeys(texts))
    checks: dict[Any, list[tuple[CaseNotes, Check]]] = {}
    sentences: dict[str, list[CaseNotes]] = {}
    order: dict[Any, None] = {}  # the keys of checks and sentences, each once, as they come
    for entry in entries:
        for note in entry.notes:
            if isinstance(note, str):
                sentences.setdefault(note, []).append(entry)
                order[note] = None
            elif note.failing:
                key = (note.name, note.reason, note.at_least)
                checks.setdefault(key, []).append((entry, note))
                order[key] = None
    texts = list[str]()
    for key in order:
        if key in checks:
            texts.append(_tell_check(checks[key], entries))
        else:
            of_cases = sentences[key]
            where = _describe_values([entry.values for entry in of_cases], entries)
            texts.append(f"{where}: {key}" if where else key)
    return texts


def _tell_case(entry: CaseNotes) -> list[str]:
    """Return the warnings of an ``entry`` on the only case of a sweep, or on a single state."""
    texts = list[str]()
    for note in entry.notes:
        text: str | None = None
        if isinstance(note, str):
            text = note
        else:
            text = note.tell(_find_place(entry, note), _find_force_unit(entry.case))
        if text is not None:
            texts.append(text)
    return texts


def _find_force_unit(case: Case) -> str:
    """Return the unit in which the user wrote the forces of contacts; empty if the loads of a case
    are no such forces, or have no unit.
    """
    return case.written.units.get("force", "")


def _find_place(entry: CaseNotes, check: Check) -> str:
    """Return in words the loads at which the condition ``check`` of an ``entry`` fails. The text is
    empty if the condition fails at none or at all of the loads, if the loads are not known, or if
    the condition's own text names them.
    """
    failing_loads = entry.find_failing(check)
    # the text of a condition on the medium names forces of contacts: the loads, if they are given
    # as these forces
    is_given_as_force = entry.case.load.kind == "force" and entry.case.written.load is None
    text_names_loads = check.name == "medium" and is_given_as_force
    if failing_loads is None or text_names_loads:
        return ""
    if not 0 < failing_loads.size < entry.n_loads:
        return ""
    return _describe_loads(entry.case, failing_loads)


def _tell_check(failures: Sequence[tuple[CaseNotes, Check]], entries: Sequence[CaseNotes]) -> str:
    """Return the warning of one limit of a sweep, whose notes are the ``entries``.

    ``failures`` are pairs of the entry of a case that passes the limit and the condition that
    fails. The warning has the number of states beyond the limit, where these states lie, the worst
    value, and where the worst value lies.
    """
    _entry, check = failures[0]
    media = {entry.case.medium.label for entry, _ in failures}
    all_entries = list(entries)
    if check.name == "medium":  # a limit of one medium
        all_entries = [entry for entry in entries if entry.case.medium.label in media]
        if len(all_entries) == 1:  # the medium says by itself at how many of its loads
            (entry,) = all_entries
            return str(check.tell(_find_place(entry, check), _find_force_unit(entry.case)))
    n_states = _count_states(all_entries)
    n_failing = sum(check.failing for _, check in failures)
    share = f"at {n_failing} of {n_states} states"
    if n_failing == n_states:
        share = f"at all {n_states} states"
    places = _describe_places(failures, all_entries)
    if places:
        share += f" ({places})"
    worst_entry, worst_check = max(failures, key=lambda pair: pair[1].excess)
    worst_load = None
    if worst_entry.find_failing(worst_check) is not None:
        worst_index = worst_check.worst_index
        loads = worst_entry.loads
        worst_load = worst_index if loads is None else int(loads[worst_index])
    place = ""
    if n_failing > 1:  # the place of a single state is told already
        place = _describe_worst(worst_entry, worst_load, all_entries)
    return worst_check.tell_states(share, place, _find_force_unit(worst_entry.case))


def _count_states(entries: Sequence[CaseNotes]) -> int:
    """Return the number of states that the notes are about. A case may have several entries, whose
    common loads count once.
    """
    loads_of_cases: dict[str, set[int]] = {}
    for entry in entries:
        loads = range(entry.n_loads) if entry.loads is None else entry.loads.tolist()
        loads_of_cases.setdefault(entry.case.label, set()).update(loads)
    return sum(map(len, loads_of_cases.values()))


def _describe_places(
    failures: Sequence[tuple[CaseNotes, Check]], entries: Sequence[CaseNotes]
) -> str:
    """Return in words where the states beyond a limit lie: the media, the values of parameters and
    the loads. ``failures`` are those of :func:`_tell_check`.

    Media are left out if the states beyond the limit have all the media of the ``entries``; so are
    the values of a parameter, and the loads. Loads are also left out if the loads of one of the
    ``failures`` are not known.
    """
    words = [_describe_values([entry.values for entry, _ in failures], entries)]
    loads_of_entries = [entry.find_failing(check) for entry, check in failures]
    known_loads = [loads for loads in loads_of_entries if loads is not None]
    if len(known_loads) == len(loads_of_entries):
        case = failures[0][0].case
        failing_loads = np.unique(np.concatenate(known_loads))
        if failing_loads.size < case.load.size:
            words.append(_describe_loads(case, failing_loads))
    return ", ".join(filter(None, words))


def _describe_worst(entry: CaseNotes, index: int | None, entries: Sequence[CaseNotes]) -> str:
    """Return in words where the worst of several states lies: those of the medium and the
    parameters of its ``entry`` that differ among the ``entries``, and the load number ``index``.
    The load is left out if ``index`` is None, for a load that is not known, and if there is one
    load.
    """
    words = []
    for name, text in entry.values.items():
        if len({other.values.get(name) for other in entries}) > 1:
            words.append(_write_value(name, text))
    if index is not None and entry.n_loads > 1:
        words.append(_describe_loads(entry.case, np.array([index])))
    return ", ".join(words)


def _write_value(name: str, text: str) -> str:
    """Return a value of a parameter, ``text``, after the ``name`` of the parameter, which a medium
    does not need.
    """
    return text if name == "medium" else f"{name} {text}"


def _describe_values(values: Sequence[Mapping[str, str]], entries: Sequence[CaseNotes]) -> str:
    """Return in words the ``values``, by name, of the medium and the parameters of some cases. A
    name is left out if these cases have all the values that the ``entries`` have of it.
    """
    words = []
    for name in values[0]:
        all_texts = list(dict.fromkeys(entry.values[name] for entry in entries))
        texts_of_cases = {values_of_case[name] for values_of_case in values}
        texts = [text for text in all_texts if text in texts_of_cases]
        if len(texts) == len(all_texts):
            continue
        words.append(_write_value(name, _list_texts(texts, all_texts)))
    return ", ".join(words)


def _list_texts(texts: Sequence[str], all_texts: Sequence[str]) -> str:
    """Return the ``texts``, some of ``all_texts`` and in their order, in words: up to
    :data:`_MOST_VALUES` as a list, more neighbours as a range, others as their number with the
    first and the last.
    """
    if len(texts) == 1:
        return texts[0]
    if len(texts) <= _MOST_VALUES:
        return f"{', '.join(texts[:-1])} and {texts[-1]}"
    start = all_texts.index(texts[0])
    if list(all_texts[start : start + len(texts)]) == list(texts):
        return f"{texts[0]} to {texts[-1]}"
    return f"{len(texts)} values from {texts[0]} to {texts[-1]}"


def _describe_loads(case: Case, indices: NDArray[np.intp]) -> str:
    """Return in words the least and the greatest of the loads of the ``indices`` of a case, as the
    user wrote them; equal ends are told once.
    """
    load = case.load if case.written.load is None else case.written.load
    lattice = case.packing.structure
    unit = find_load_unit(load.kind, lattice.periods, lattice.pressed_axes)
    written_unit = case.written.units.get(load.kind, "")
    loads = np.unique(np.ravel(load.array)[indices])
    ends = dict.fromkeys([loads[0], loads[-1]])
    texts = [write_in(float(end), unit, written_unit) for end in ends]
    return f"{load.kind} {' to '.join(texts)}"
