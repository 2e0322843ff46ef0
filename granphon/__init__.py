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
    """Return the public attribute ``name``, which is imported now and kept in the module: Python
    calls this for a name that the module does not hold yet.

    Raises AttributeError for a name that is not public, and MissingPackageError if a package that
    the name needs is not installed.
    """
    if name == "observables":  # the package, for gp.observables.register
        return import_module(".observables", __name__)
    if name not in _HOME:
        raise AttributeError(f"module 'granphon' has no attribute {name!r}")
    from granphon.base.errors import needing

    with needing(f"granphon.{name}"):
        value: object = getattr(import_module(_HOME[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names of the module with all public names, also those not imported yet; each
    once.
    """
    return sorted({*globals(), *_HOME})
