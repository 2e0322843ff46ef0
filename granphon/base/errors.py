"""The errors that granphon raises, and its one warning.

Every error is a :class:`GranphonError` and also the built-in exception that a caller would expect,
so that both ``except gp.GranphonError`` and ``except ValueError`` work. A message says what is wrong,
why it matters, and how to mend it.
"""

from __future__ import annotations

import re

__all__ = [
    "ConvergenceError",
    "FigureError",
    "FileExistsInRunError",
    "GranphonError",
    "InputError",
    "InstabilityError",
    "MechanismError",
    "MissingFileError",
    "MissingSceneError",
    "OutputError",
    "PrecisionError",
    "Refused",
    "SceneError",
    "UnreachableFrequencyError",
    "UnsupportedError",
    "UnverifiedFileWarning",
    "brief",
    "message",
]

#: bits of a whole number that no float holds
_TOO_LARGE = 1024
#: what ends a line, with the space about it
_BREAK = re.compile(r"\s*[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]\s*")


class GranphonError(Exception):
    """Root of every error that granphon raises on purpose.

    ``load_index`` is the place of the load that cannot be carried among several; None if the error is not one of a load. It
    comes back from a worker process too.
    """

    load_index: int | None = None


class InputError(GranphonError, ValueError):
    """A value that cannot be: of the wrong kind, out of range, or inconsistent with another."""


class Refused(InputError):
    """A value that a rule of :mod:`granphon.base.validation` does not take.

    ``found`` is the value, ``allowed`` what the rule takes, ``mend`` the likely intention. ``path`` are the keys and places
    in lists that lead from the value which the rule was given to the one that it refuses.
    """

    def __init__(self, found: str, allowed: str, mend: str = "", path: tuple[str | int, ...] = ()) -> None:
        super().__init__(f"found {found}; allowed: {allowed}." + (f" {mend}" if mend else ""))
        self.found, self.allowed, self.mend, self.path = found, allowed, mend, path

    def __reduce__(self) -> tuple[type[Refused], tuple[object, ...]]:
        return Refused, (self.found, self.allowed, self.mend, self.path)  # it comes back from worker processes too

    def under(self, *keys: str | int) -> Refused:
        """The same refusal of a value that stands at ``keys``."""
        return Refused(self.found, self.allowed, self.mend, (*keys, *self.path))


class SceneError(InputError):
    """A scene file that cannot be carried out; names file, line and key."""


class MissingFileError(InputError, FileNotFoundError):
    """A file that is to be read is not there."""


class MissingSceneError(SceneError, MissingFileError):
    """A scene file that is not there."""


class MechanismError(InputError):
    """The lattice has a deformation that costs no energy: it is a mechanism, not a solid."""


class UnreachableFrequencyError(InputError):
    """A branch does not reach the frequency that was asked of it."""


class PrecisionError(InputError):
    """The result asked for has no correct digit in double precision."""


class InstabilityError(GranphonError, RuntimeError):
    """The state is not a minimum of the energy: a squared frequency is negative."""


class ConvergenceError(GranphonError, RuntimeError):
    """An iteration has not reached its tolerance; says what it has reached."""


class UnsupportedError(GranphonError, NotImplementedError):
    """A method that exists, but would give a wrong answer for these objects."""


class FigureError(GranphonError, RuntimeError):
    """A figure that matplotlib could not draw."""


class OutputError(GranphonError, OSError):
    """A result that could not be written."""


class FileExistsInRunError(OutputError):
    """A result is already there, and overwriting was not asked for."""


class UnverifiedFileWarning(UserWarning):
    """A file was read that carries no digest: whether it is as granphon wrote it cannot be told."""


def message(what: str, why: str = "", mend: str = "") -> str:
    """Join the three parts of an error message, what is wrong, why, and how to mend it, to one line."""
    sentences = [_one_line(part).rstrip(". ") for part in (what, why, mend) if part]
    return " ".join(one if one.endswith("?") else f"{one}." for one in sentences)


def brief(value: object, most: int = 80) -> str:
    """A value as a message shows it: its repr on one line, cut; a whole number beyond the range of floats by its size."""
    if isinstance(value, int) and value.bit_length() >= _TOO_LARGE:
        return f"a whole number of about {int(0.30103 * value.bit_length()) + 1} digits, which is too large"
    if isinstance(value, list | tuple) and any(isinstance(one, int) and one.bit_length() >= _TOO_LARGE for one in value):
        return "a list with a number that is too large"
    try:
        text = _one_line(repr(value))
    except ValueError:  # Python does not write whole numbers of more than 4300 digits
        return "an array with a number that is too large"
    except RecursionError:
        return "a list that is nested without end"
    return text if len(text) <= most else text[: most - 3] + "..."


def _one_line(text: str) -> str:
    return _BREAK.sub(" ", text)
