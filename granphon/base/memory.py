"""Memory: what this machine has left, and the error of work that would take more.

Every call that takes a size asks :func:`require_memory` before its work begins.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from granphon.base.errors import InputError

#: memory that any machine is taken to have, bytes: to ask the system takes longer than small work
_ALWAYS = 1e8
#: for both versions of control groups, by the name of the controller: the folder, the files of the
#: limit and of the use, and the entry of memory.stat with the cache that can be given back
_GROUPS = {
    "memory": (
        "sys/fs/cgroup/memory",
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
    "": ("sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
}


def available_memory(root: Path = Path("/")) -> float:
    """Return the memory that this process may still take, bytes; infinite if the system does not
    report it.

    On Linux it is the least of the memory that the kernel reports as available and of what is left
    of the limits of the process itself (of its addresses), of its control group and of the groups
    above it. Elsewhere it is the free memory, or failing that the total memory. ``root`` is the
    folder of the system's files.
    """
    return min(_free_memory(root), _free_addresses(root), _free_of_groups(root))


def _read_words(path: Path) -> list[list[str]]:
    """Return the words of each line of a file; none if the file cannot be read."""
    try:
        text = path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return []
    return [line.split() for line in text.split("\n")]


def _read_number(path: Path, name: str = "") -> float | None:
    """Return the number after a name, perhaps with a unit behind, or alone in a file; None if there
    is none ("max").
    """
    for words in _read_words(path):
        if words and name in ("", words[0]):
            number = words[-2] if len(words) > 2 else words[-1]
            return float(number) if number.isdigit() else None
    return None


def _free_memory(root: Path) -> float:
    """Return the memory of the machine that is available, bytes; infinite if that is not known."""
    free = _read_number(root / "proc/meminfo", "MemAvailable:")
    if free is not None:
        return free * 1024.0
    names = getattr(os, "sysconf_names", ())
    pages = next((name for name in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES") if name in names), None)
    if pages is None or "SC_PAGE_SIZE" not in names:
        return math.inf
    return float(os.sysconf(pages)) * float(os.sysconf("SC_PAGE_SIZE"))


def _free_addresses(root: Path) -> float:
    """Return what is left of the limit of addresses of this process, bytes; infinite without a
    limit.
    """
    used = _read_number(root / "proc/self/status", "VmSize:")
    for words in _read_words(root / "proc/self/limits"):
        if words[:3] == ["Max", "address", "space"]:
            limit = words[3]
            if not limit.isdigit() or used is None:
                return math.inf
            return max(float(limit) - used * 1024.0, 0.0)
    return math.inf


def _free_of_groups(root: Path) -> float:
    """Return what is left of the limits of the control groups of this process, bytes; infinite
    without limits.
    """
    least = math.inf
    for words in _read_words(root / "proc/self/cgroup"):
        _, _, hierarchy = " ".join(words).partition(":")
        controllers, _, path = hierarchy.partition(":")
        kind = "memory" if "memory" in controllers.split(",") else controllers
        if kind not in _GROUPS:
            continue
        place, limit, use, cache = _GROUPS[kind]
        group = Path(path.lstrip("/"))
        # limits of groups above count too; in a container some may be missing
        for folder in (group, *group.parents):
            control_group = root / place / folder
            most = _read_number(control_group / limit)
            used = _read_number(control_group / use)
            if most is None or used is None:
                continue
            cached = _read_number(control_group / "memory.stat", cache) or 0.0
            least = min(least, max(most - used + cached, 0.0))
    return least


def require_memory(what: str, needed: float, mend: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if work needs more memory, bytes, than this
    machine has available.

    ``what`` says what takes it, as the subject of a sentence in the plural, and ``mend`` how to
    take less.
    """
    if needed <= _ALWAYS:
        return
    free = available_memory()
    if needed > free:
        why = f"This machine has {write_bytes(free)} available"
        raise InputError(f"{what} take {write_bytes(needed)} of memory", why, mend)


def write_bytes(amount: float) -> str:
    """Return an amount of memory as text, such as 3.2 GB."""
    return f"{amount / 1e9:,.3g} GB" if amount < 1e12 else f"{amount / 1e9:.2e} GB"
