"""Memory: what this machine has left, and the error of work that would take more.

Every call that takes a size asks :func:`require_memory` before its work begins.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from granphon.base.errors import InputError

#: memory that any machine is taken to have, bytes: to ask the system takes longer than small work
_ASSUMED_MEMORY = 1e8
#: the unit of the kernel's "kB", bytes
_KIBIBYTE = 1024.0
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

    On Linux the available memory is the least of three: the memory that the kernel reports as
    available, what is left of the limit of the process (of its addresses), and what is left of the
    limits of its control group and of the groups above. Elsewhere it is the free memory, or failing
    that the total memory. ``root`` is the folder of the system's files.
    """
    return min(_free_memory(root), _free_addresses(root), _free_of_groups(root))


def _read_words(path: Path) -> list[list[str]]:
    """Return the words of each line of a file; none if the file cannot be read."""
    try:
        text = path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return []
    return [line.split() for line in text.split("\n")]


def _read_number(path: Path, first_word: str = "") -> float | None:
    """Return the number on the line of a file that begins with the ``first_word``, or if that is
    empty on the first line; None if there is no such line, or no number on it, as in "max".

    The number ends the line ("inactive_file 512"), or stands before its unit ("VmSize: 512 kB").
    """
    for words in _read_words(path):
        if not words:
            continue
        if first_word in ("", words[0]):
            has_unit = len(words) > 2
            number = words[-2] if has_unit else words[-1]
            return float(number) if number.isdigit() else None
    return None


def _free_memory(root: Path) -> float:
    """Return the memory of the machine that is available, bytes; infinite if that is not known.
    ``root``, here and below, is that of :func:`available_memory`.
    """
    kibibytes = _read_number(root / "proc/meminfo", "MemAvailable:")
    if kibibytes is not None:
        return kibibytes * _KIBIBYTE
    # outside Linux: the free pages, or else all pages
    names = getattr(os, "sysconf_names", ())
    page_counts = [name for name in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES") if name in names]
    if not page_counts or "SC_PAGE_SIZE" not in names:
        return math.inf
    return float(os.sysconf(page_counts[0])) * float(os.sysconf("SC_PAGE_SIZE"))


def _free_addresses(root: Path) -> float:
    """Return what is left of the limit of addresses of this process (ulimit -v), bytes; infinite
    without a limit.
    """
    used_kibibytes = _read_number(root / "proc/self/status", "VmSize:")
    for words in _read_words(root / "proc/self/limits"):
        # the line is "Max address space", the limit in bytes or "unlimited", and more columns
        if words[:3] == ["Max", "address", "space"]:
            limit = words[3]
            if not limit.isdigit() or used_kibibytes is None:
                return math.inf
            return max(float(limit) - used_kibibytes * _KIBIBYTE, 0.0)
    return math.inf


def _free_of_groups(root: Path) -> float:
    """Return what is left of the limits of the control groups of this process, bytes; infinite
    without limits.
    """
    free = math.inf
    for words in _read_words(root / "proc/self/cgroup"):
        # a line is "number:controllers:path"; version 2 of control groups names no controllers
        _, _, controllers_and_path = " ".join(words).partition(":")
        controllers, _, path = controllers_and_path.partition(":")
        controller = "memory" if "memory" in controllers.split(",") else controllers
        if controller not in _GROUPS:
            continue
        hierarchy = root / _GROUPS[controller][0]
        group = Path(path.lstrip("/"))
        # limits of groups above count too; in a container some may be missing
        for ancestor in (group, *group.parents):
            free = min(free, _free_of_group(hierarchy / ancestor, controller))
    return free


def _free_of_group(folder: Path, controller: str) -> float:
    """Return what is left of the limit of the control group in ``folder``, bytes, with the cache
    that can be given back; infinite without a limit. ``controller`` is the key of ``_GROUPS``.
    """
    _, limit_file, use_file, cache_entry = _GROUPS[controller]
    limit = _read_number(folder / limit_file)
    use = _read_number(folder / use_file)
    if limit is None or use is None:
        return math.inf
    cache = _read_number(folder / "memory.stat", cache_entry) or 0.0
    return max(limit - use + cache, 0.0)


def require_memory(what: str, needed: float, mend: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the memory ``needed`` by some work, bytes,
    is more than this machine has available, and more than the 100 MB that any machine is taken to
    have.

    In the message, ``what`` is the subject of "take ... of memory", such as "64 states", and
    ``mend`` says how to take less.
    """
    if needed <= _ASSUMED_MEMORY:
        return
    free = available_memory()
    if needed > free:
        why = f"This machine has {write_bytes(free)} available"
        raise InputError(f"{what} take {write_bytes(needed)} of memory", why, mend)


def write_bytes(amount: float) -> str:
    """Return an ``amount`` of memory, bytes, as text in gigabytes, such as 3.2 GB."""
    return f"{amount / 1e9:.3g} GB"
