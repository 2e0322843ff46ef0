"""The errors that granphon raises, and its warnings.

Every error is a :class:`GranphonError` and also the built-in exception that a caller would expect,
so that both ``except gp.GranphonError`` and ``except ValueError`` work. A message says what is
wrong, why it matters, and how to mend it.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from importlib.util import find_spec
from typing import Any, Self, TypeGuard

#: the least whole number that is too large for a float: a smaller whole number is rounded to the
#: largest float at most
LEAST_TOO_LARGE = 2**1024 - 2**970
#: the extras of granphon, each with the packages that it brings, by their names when they are
#: imported
EXTRAS = {
    "scenes": (
        "matplotlib",
        "typer",
        "rich",
        "yaml",
        "xarray",
        "h5netcdf",
        "h5py",
        "threadpoolctl",
    ),
    "distributed": ("distributed", "dask"),
}
#: decimal digits that one bit of a whole number stands for: the decimal logarithm of 2
_DIGITS_PER_BIT = 0.30103
#: what ends a line, with the white space around it
_BREAK = re.compile(r"\s*[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]\s*")


class GranphonError(Exception):
    """Root of every error that granphon raises on purpose.

    ``load_index`` is the index, among several loads, of the one that cannot be carried; None if the
    error is not about a load. The index is kept when the error comes back from a worker process.
    ``block`` holds the keys that lead to the part of a scene that the error is about, as
    ("motion",); None if that part is not known. ``option`` is the name of the option of a medium
    that the error is about, as the start of a loading; None if the error is about none. ``reached``
    is the state, or the data set of a sweep, at the loads of a path before the error; None if there
    is none.

    The constructor takes sentences: what is wrong and where, why it matters, how to mend it. The
    text of the error is their :func:`message`.
    """

    load_index: int | None = None
    block: tuple[str, ...] | None = None
    option: str | None = None
    reached: Any = None

    def __init__(self, what: str = "", why: str = "", mend: str = "") -> None:
        """Make the text of the error from its sentences."""
        # args is set here, as OSError would take several arguments for a number and a file
        self.args = (message(what, why, mend),)

    def restate(self, text: str) -> Self:
        """Return an error of the same class with another text, and with the attributes of this
        error.
        """
        restated = copy(self)
        # the text goes through message as in the constructor, because unpickling calls the
        # constructor with args, and must find the same text
        restated.args = (message(text),)
        return restated


class InputError(GranphonError, ValueError):
    """A value of the wrong kind, out of range, or inconsistent with another."""


class Refused(InputError):
    """A value that a rule of :mod:`granphon.base.validation` does not take.

    ``found`` says what the value is, ``allowed`` what the rule takes, ``mend`` what was probably
    meant. ``path`` holds the keys and list indices that lead from the value given to the rule to
    the part of the value that is refused.
    """

    def __init__(
        self, found: str, allowed: str, mend: str = "", path: tuple[str | int, ...] = ()
    ) -> None:
        """Make the text of the refusal from what was found, what is allowed, and how to mend it."""
        ending = "."
        if mend[:1].islower():
            # a mend in lower case, such as the text of another error, is no sentence of its own
            ending = f"; {mend}"
        elif mend:
            ending = f". {mend}".rstrip()
        super().__init__(f"found {found}; allowed: {allowed}{ending}")
        self.found = found
        self.allowed = allowed
        self.mend = mend
        self.path = path

    def __reduce__(self) -> tuple[type[Refused], tuple[object, ...], dict[str, object]]:
        """Return class, arguments and attributes, from which a copy or pickle is made.

        The attributes hold ``args`` too, so that a restated refusal keeps its text.
        """
        arguments = (self.found, self.allowed, self.mend, self.path)
        attributes = vars(self) | {"args": self.args}
        return Refused, arguments, attributes

    def under(self, *keys: str | int) -> Refused:
        """Return the same refusal, with its attributes, and with ``keys`` before its path: the keys
        lead to the value from the block or list around the value.
        """
        refused = copy(self)
        refused.path = (*keys, *self.path)
        return refused


class SceneError(InputError):
    """A scene file that cannot be carried out; the message names file, line and key."""


class SchemaError(InputError):
    """A file or plain data of another schema than this version reads."""


class MissingFileError(InputError, FileNotFoundError):
    """A file that should be read does not exist."""

    def __new__(cls, *sentences: str, **named: str) -> Self:
        """Return a new error, as FileNotFoundError makes it; the arguments are those of the
        constructor, which sets the text.

        dask rebuilds errors by ``__new__`` alone, without calling the class; Python would then find
        the ``__new__`` of ``ValueError``, which cannot make a FileNotFoundError.
        """
        return FileNotFoundError.__new__(cls)


class MissingSceneError(SceneError, MissingFileError):
    """A scene file that does not exist."""


class MechanismError(InputError):
    """The lattice has a deformation that costs no energy: it is a mechanism, not a solid."""


class UnreachableFrequencyError(InputError):
    """A branch of the dispersion does not reach the requested frequency."""


class PrecisionError(InputError):
    """The requested result would have no correct digit in double precision."""


class InstabilityError(GranphonError, RuntimeError):
    """The state is not a minimum of the energy: a squared frequency is negative."""


class ConvergenceError(GranphonError, RuntimeError):
    """An iteration has not reached its tolerance; the message says what it has reached.

    ``reached`` is the last state of a loading history before the failure, the state at the loads of
    a path before the failure, or the data set of a sweep at these loads; None elsewhere.
    """


class UnsupportedError(GranphonError, NotImplementedError):
    """A method that would give a wrong answer for these objects, though it works for others."""


class FigureError(GranphonError, RuntimeError):
    """A figure that matplotlib could not draw."""


class OutputError(GranphonError, OSError):
    """A result that could not be written."""


class FileExistsInRunError(OutputError):
    """A file stands where a result is to be written, and it may not be overwritten."""


class MissingPackageError(GranphonError, ImportError):
    """A package that is needed here, and not elsewhere, is not installed."""


class InconsistencyWarning(UserWarning):
    """Numbers that were given contradict each other: a force is not that of its overlap."""


class StoppedEarlyWarning(UserWarning):
    """A run has ended before its time, or a file was read that such a run left; the results up to
    the end are kept. ``interrupted`` says whether Ctrl-C ended the run.
    """

    interrupted = False


class LimitWarning(UserWarning):
    """A motion goes beyond a limit of its model."""


class UnverifiedFileWarning(UserWarning):
    """A file without a digest was read: nothing shows whether it is still as it was written."""


class CacheWarning(UserWarning):
    """Loops that were compiled could not be read, or not be kept: they are compiled anew, and give
    the same numbers.
    """


@contextmanager
def needing(what: str) -> Iterator[None]:
    """Raise :class:`MissingPackageError` where a block imports a package that is not installed.

    ``what`` is the subject of the message: a file or feature that needs the package. The message
    names the extra of granphon that brings the package, or else the package itself. A module that
    granphon or an installed package lacks is another error, which passes as it is.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        if package in ("None", "granphon"):  # a module of granphon itself, or an unnamed one
            raise
        if error.name != package and package in sys.modules:  # a module of an installed package
            raise
        to_install = package
        for extra, packages in EXTRAS.items():
            if package in packages:
                to_install = f'"granphon[{extra}]"'
                break
        problem = f"{what} needs {package}, which is not installed"
        raise MissingPackageError(problem, mend=f"Install it: pip install {to_install}") from None


def require_installed(what: str, *packages: str) -> None:
    """Raise :class:`MissingPackageError`, as :func:`needing` does, if one of ``packages``, which
    ``what`` needs, is not installed. No package is imported.
    """
    for package in packages:
        with needing(what):
            if find_spec(package) is None:
                raise ModuleNotFoundError(name=package)


def warn_caller(text: str, category: type[Warning]) -> None:
    """Issue a warning at the line, outside of granphon, from which granphon was called, or at the
    outermost line if all are granphon's.
    """
    level = 1
    frame = sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == "granphon":
        frame = frame.f_back
        level += 1
    warnings.warn(text, category, stacklevel=level)


def message(what: str, why: str = "", mend: str = "") -> str:
    """Return an error message on one line: the sentences ``what`` is wrong, ``why`` it matters and
    how to ``mend`` the error, without those that are blank. Each sentence gets a full stop, unless
    it ends in a question mark or three dots.

    Letters that cannot be printed are escaped, as a message may quote a file of unknown origin.
    """
    sentences = []
    for words in (what, why, mend):
        if not words.strip():
            continue
        sentence = one_line(words).rstrip()
        # three dots stay: they say that text has been cut off
        if not sentence.endswith(("?", "...")):
            sentence = sentence.rstrip(". ") + "."
        sentences.append(sentence)
    return " ".join(sentences)


def brief(value: object, most: int = 80) -> str:
    """Return a value as a message shows it: its repr on one line, cut to ``most`` characters; a
    scalar of NumPy has the repr of Python's.

    A whole number beyond the range of floats is described by its number of digits. In words are
    described a list or tuple with such an entry, and a value whose repr Python does not write: one
    that holds a whole number of more than 4300 digits, or is nested too deeply.
    """
    if _is_too_large(value):
        digits = int(_DIGITS_PER_BIT * value.bit_length()) + 1
        return f"a whole number of about {digits} digits, which is too large"
    if isinstance(value, list | tuple) and any(map(_is_too_large, value)):
        return "a list with a number that is too large"
    # known by its attributes, as the command's help needs no numpy
    is_numpy_scalar = type(value).__module__ == "numpy" and getattr(value, "shape", None) == ()
    scalar: Any = value
    try:
        text = one_line(repr(scalar.item() if is_numpy_scalar else value))
    except ValueError:  # a whole number of more than 4300 digits, which Python does not write
        return "a value with a number that is too large"
    except RecursionError:
        return "a value that is nested too deeply"
    if len(text) <= most:
        return text
    ellipsis = "..."
    return text[: most - len(ellipsis)] + ellipsis


def _is_too_large(value: object) -> TypeGuard[int]:
    """Whether a value is a whole number beyond the range of floats."""
    return isinstance(value, int) and abs(value) >= LEAST_TOO_LARGE


def one_line(text: str) -> str:
    """Return a text on one line, with letters that cannot be printed as escapes: a terminal would
    obey control characters.
    """
    line = _BREAK.sub(" ", text)
    if line.isprintable():
        return line
    letters = []
    for letter in line:
        escaped = repr(letter)[1:-1]  # without its quotes
        letters.append(letter if letter.isprintable() else escaped)
    return "".join(letters)
