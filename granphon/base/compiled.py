"""Loops over contacts or balls that NumPy could only make in many passes, compiled by Numba when
they are first called.

Numba keeps the compiled loops in a cache: beside the module, as Python keeps its bytecode, or in
the user's cache folder where the module's folder cannot be written. Nothing depends on the cache:
where it is damaged or cannot be written, loops are compiled in each process. The first loop that a
process compiles is announced on stderr, as compilation may take half a minute. Without Numba
they are loops of Python, which give the same numbers, hundreds of times slower.
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

#: how Numba compiles: with the arithmetic of NumPy, where x/0 is no error; without the wrapper by
#: which C would call a loop, which takes some hundredths of the time of compilation
_HOW: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_SLOW = "The same takes hundreds of times longer"
#: the message that says why loops are not compiled; empty where they are
UNCOMPILED = ""
if njit is None:
    UNCOMPILED = message("numba is not installed", _SLOW, "Install it: pip install numba")
elif config.DISABLE_JIT:
    UNCOMPILED = message("numba compiles nothing, as NUMBA_DISABLE_JIT is set", _SLOW, "Unset it")


def compiled(loop: _Loop) -> _Loop:
    """Return the ``loop``, a function of arrays and numbers, compiled with the arithmetic of NumPy:
    x/0 is no error.

    The loop is compiled at its first call, which prints a line on stderr, see ``COMPILING``. If a
    compiled loop cannot be read from the cache, or cannot be kept there, the first such loop of a
    process issues a :class:`~granphon.base.errors.CacheWarning`. Without Numba the ``loop`` itself
    is returned.
    """
    if UNCOMPILED:
        return loop
    dispatcher: Any  # Numba's object that compiles the loop for each signature, and calls it
    why_no_cache = ""
    try:
        dispatcher = njit(cache=True, **_HOW)(loop)
        _survive_cache_errors(dispatcher._cache)
    except RuntimeError:  # Numba has found no folder for its cache
        dispatcher = njit(**_HOW)(loop)
        why_no_cache = "There is no folder that can be written"
    compile_for = dispatcher.compile

    def compile_whole(signature: Any) -> Any:
        """Compile the loop for one signature of argument types, as Numba does.

        A Ctrl-C waits until the end: in the middle, Numba could lose the Ctrl-C, or fail with an
        error of its own.
        """
        if why_no_cache:
            _warn_of_cache(why_no_cache)
        with hold_back_signals():
            return compile_for(signature)

    dispatcher.compile = compile_whole
    compile_anew = dispatcher._compiler.compile

    def announce_and_compile(arguments: Any, returned: Any) -> Any:
        """Compile the loop after a note that this takes long."""
        _announce_compilation()
        return compile_anew(arguments, returned)

    dispatcher._compiler.compile = announce_and_compile
    return cast("_Loop", dispatcher)


def _survive_cache_errors(cache: Any) -> None:
    """Replace the two methods by which Numba reads and writes its ``cache``: instead of raising an
    error they issue a warning and clear the index, so that the loop is compiled anew.
    """

    def survive_errors_of(access: Callable[..., Any]) -> Callable[..., Any]:
        """Return a method that calls ``access`` or, if that raises an error, warns and returns
        None.
        """

        def access_or_warn(*arguments: Any) -> Any:
            """Return what ``access`` returns; None, with a warning, if the cache cannot be used."""
            try:
                return access(*arguments)
            except Exception as error:  # reading a file that was cut may raise anything
                # the index goes: it may name a file that another version of the loop has left
                with suppress(OSError):
                    os.unlink(cache._cache_file._index_path)
                reason = str(error) or type(error).__name__
                _warn_of_cache(f"{cache.cache_path}: {reason}")
                return None

        return access_or_warn

    cache.load_overload = survive_errors_of(cache.load_overload)
    cache.save_overload = survive_errors_of(cache.save_overload)


#: the line on stderr when a loop is compiled
COMPILING = "granphon: loops are compiled, once on this machine; this may take half a minute"
#: the announcements that this process has made; empty before
_announcements: list[str] = []


def _announce_compilation() -> None:
    """Say on stderr that loops are compiled, once in a process."""
    if not _announcements:
        _announcements.append(COMPILING)
        print(COMPILING, file=sys.stderr, flush=True)


#: the warning about the cache that this process has issued; empty before
_issued_warnings: list[str] = []


def _warn_of_cache(reason: str) -> None:
    """Issue, once in a process, the warning that loops are compiled which a cache should hold."""
    if not _issued_warnings:
        warning = message(
            "what numba has compiled cannot be read, or not be kept",
            reason,
            "It is compiled anew",
        )
        _issued_warnings.append(warning)
        warnings.warn(warning, CacheWarning, stacklevel=2)
