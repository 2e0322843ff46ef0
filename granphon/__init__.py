"""granphon: the vibrations and sound velocities of granular crystals.

Each public name is imported when it is first used, so that ``import granphon`` stays fast and a
computation loads only what it needs. The names are listed once, in the stub ``__init__.pyi`` beside
this file; type checkers read the stub instead of this file.
"""

from importlib import import_module

__version__ = "0.1.0"

# each public name has one line in the stub: from .package.module import name as name
with open(f"{__file__}i", encoding="utf-8") as stub:
    #: for each public name, the module that defines it, relative to this package
    _HOME = {line.split()[-1]: line.split()[1] for line in stub if line.startswith("from ")}
del stub

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> object:
    if name == "observables":  # the package, for gp.observables.register
        return import_module(".observables", __name__)
    if name not in _HOME:
        raise AttributeError(f"module 'granphon' has no attribute {name!r}")
    from granphon.base.errors import needing

    with needing(f"granphon.{name}"):
        globals()[name] = value = getattr(import_module(_HOME[name], __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
