"""Contact forces in the messages of errors: in newton, as users give and read them.

What solves in reduced units knows forces as f*, over that of equal balls at an overlap of the
width, and writes "f* = 0.08" into its errors. Media, which know their packing, put the contact
force in newton in the place of these texts.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError
from granphon.base.quantities import NUMBER
from granphon.base.scales import write_quantity

_REDUCED_FORCE = re.compile(rf"f\* = ({NUMBER})")
#: digits of a force
_DIGITS = 4

_Arguments = ParamSpec("_Arguments")
_Returned = TypeVar("_Returned")


class _OfPacking(Protocol):
    """An object that has a packing, as a medium has."""

    @property
    def packing(self) -> Packing: ...


_MediumT = TypeVar("_MediumT", bound=_OfPacking)


def write_force(packing: Any, reduced_force: float) -> str:
    """Return the text of the contact force, N, of a reduced force f* in a packing."""
    return write_quantity(reduced_force * packing.width_units.force, "N", _DIGITS)


def write_newtons(error: GranphonError, packing: Any) -> GranphonError:
    """Return an error with the contact forces of a ``packing`` in the place of reduced forces in
    its text. The same error is returned if its text has none, and if there is no packing or its
    balls are equal.
    """
    text = str(error)
    if "f* = " not in text or not getattr(packing, "width", 0.0):
        return error
    text_in_newtons = _REDUCED_FORCE.sub(lambda match: write_force(packing, float(match[1])), text)
    return error.restate(text_in_newtons)


def in_newtons(
    method: Callable[Concatenate[_MediumT, _Arguments], _Returned],
) -> Callable[Concatenate[_MediumT, _Arguments], _Returned]:
    """Return the ``method`` of a medium, changed so that the errors that it raises have contact
    forces in newton in the place of reduced forces. The function is a decorator.
    """

    @wraps(method)
    def call(
        medium: _MediumT, /, *arguments: _Arguments.args, **options: _Arguments.kwargs
    ) -> _Returned:
        """Return what the method returns; an error that it raises is written in newtons."""
        try:
            return method(medium, *arguments, **options)
        except GranphonError as error:
            restated_error = write_newtons(error, medium.packing)
            if restated_error is error:
                raise
            raise restated_error from error

    return call
