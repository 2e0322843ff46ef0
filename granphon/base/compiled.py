"""Loops over contacts or balls that NumPy could only make in many passes, compiled by Numba when
they are first called.

What it compiles is kept beside the module, as Python's own bytecode is, or in the user's cache
where that cannot be written. Nothing depends on what is kept: where it is damaged or cannot be
written, loops are compiled in each process. The first loop that a process compiles says so on
stderr, as it may take some ten seconds; one that is read says nothing. Without Numba they are loops
of Python, which give the same numbers, hundreds of times slower.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

try:
    from numba import config, njit
except ImportError:
    config = njit = None

from granphon.base.errors import CacheWarning, message
from granphon.base.threads import hold_back_signals

_Loop = TypeVar("_Loop", bound=Callable[..., Any])

_SLOW = "The same takes hundreds of times longer"
#: what is said where loops are not compiled; empty where they are
UNCOMPILED = ""
if njit is None:
    UNCOMPILED = message("numba is not installed", _SLOW, "Install it: pip install numba")
elif config.DISABLE_JIT:
    UNCOMPILED = message("numba compiles nothing, as NUMBA_DISABLE_JIT is set", _SLOW, "Unset it")


def compiled(loop: _Loop) -> _Loop:
    """Return the ``loop``, a function of arrays and numbers, compiled with the arithmetic of NumPy:
    x/0 is no error.

    Where what was compiled cannot be read or kept, the first loop of a process that meets it issues
    a
    :class:`~granphon.base.errors.CacheWarning`.
    """
    if UNCOMPILED:
        return loop
    made: Any
    nowhere = ""
    try:
        made = njit(cache=True, error_model="numpy")(loop)
        _end_no_run(made._cache)
    except RuntimeError:
        made = njit(error_model="numpy")(loop)
        nowhere = "There is no folder that can be written"
    compile_for = made.compile

    def compile_whole(signature: Any) -> Any:
        """Compile as Numba does, which could lose a Ctrl-C and end in an error of its own: it comes
        when this is done.
        """
        if nowhere:
            _warn(nowhere)
        with hold_back_signals():
            return compile_for(signature)

    made.compile = compile_whole
    compile_anew = made._compiler.compile

    def compile_aloud(arguments: Any, returned: Any) -> Any:
        _say()
        return compile_anew(arguments, returned)

    made._compiler.compile = compile_aloud
    return cast("_Loop", made)


def _end_no_run(cache: Any) -> None:
    """Have a cache of Numba go on without what it can neither read nor write, of which it forgets
    all.
    """

    def attempt(access: Callable[..., Any]) -> Callable[..., Any]:
        def go_on(*arguments: Any) -> Any:
            try:
                return access(*arguments)
            except Exception as error:  # what is read of a file that was cut may raise anything
                # the index goes: it may name a file that another version of the loop has left
                with suppress(OSError):
                    os.unlink(cache._cache_file._index_path)
                _warn(f"{cache.cache_path}: {str(error) or type(error).__name__}")
                return None

        return go_on

    cache.load_overload = attempt(cache.load_overload)
    cache.save_overload = attempt(cache.save_overload)


#: what is said on stderr when a loop is compiled
COMPILING = "granphon: loops are compiled, once on this machine; this may take some ten seconds"
#: whether this process has said so
_told: list[str] = []


def _say() -> None:
    """Say on stderr that loops are compiled, once in a process."""
    if not _told:
        _told.append(COMPILING)
        print(COMPILING, file=sys.stderr, flush=True)


#: what this process has said about the cache
_said: list[str] = []


def _warn(reason: str) -> None:
    """Issue the warning of a process that compiles what a cache should hold."""
    if not _said:
        _said.append(
            message(
                "what numba has compiled cannot be read, or not be kept",
                reason,
                "It is compiled anew",
            )
        )
        warnings.warn(_said[0], CacheWarning, stacklevel=2)
