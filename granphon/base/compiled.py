"""Loops over contacts or balls that NumPy could only make in many passes, compiled by Numba when they are first called.

What it compiles is kept beside the module, as Python's own bytecode is, or in the user's cache where that cannot be written.
Without Numba they are loops of Python, which give the same numbers, hundreds of times slower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

try:
    from numba import njit
except ImportError:
    njit = None

from granphon.base.threads import hold_back_signals

_Loop = TypeVar("_Loop", bound=Callable[..., Any])

#: whether loops are compiled
COMPILES = njit is not None


def compiled(loop: _Loop) -> _Loop:
    """Return the ``loop``, a function of arrays and numbers, compiled with the arithmetic of NumPy: x/0 is no error."""
    if not COMPILES:
        return loop
    made: Any
    try:
        made = njit(cache=True, error_model="numpy")(loop)
    except RuntimeError:  # there is no folder that can be written: it is compiled in each process
        made = njit(error_model="numpy")(loop)
    compile_for = made.compile

    def compile_whole(signature: Any) -> Any:
        """Compile as Numba does, which could lose a Ctrl-C and end in an error of its own: it comes when this is done."""
        with hold_back_signals():
            return compile_for(signature)

    made.compile = compile_whole
    return cast("_Loop", made)
