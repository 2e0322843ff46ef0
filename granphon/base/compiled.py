"""Loops over contacts or balls that NumPy could only make in many passes, compiled by Numba when
they are first called.

Numba takes longer to import than a band structure takes: it is imported with the first call, and
modules that hold loops are imported like any other.

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
from functools import cache, cached_property, update_wrapper
from typing import Any, TypeVar, cast

from granphon.base.errors import CacheWarning, message
from granphon.base.threads import hold_back_signals

_Loop = TypeVar("_Loop", bound=Callable[..., Any])

#: options of Numba: the arithmetic of NumPy, where x/0 is no error; and no wrapper by which C would
#: call a loop, as making one takes some hundredths of the time of compilation
_NUMBA_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}


@cache
def find_why_uncompiled() -> str:
    """Return the message that says why loops are not compiled; empty where they are."""
    consequence = "The same takes hundreds of times longer"
    try:
        from numba import config
    except ImportError as error:  # also of a version of numba that does not fit that of NumPy
        is_missing = isinstance(error, ModuleNotFoundError) and error.name == "numba"
        if is_missing:
            return message("numba is not installed", consequence, "Install it: pip install numba")
        problem = f"numba cannot be imported: {error}"
        return message(problem, consequence, "Install a version that can: pip install -U numba")
    if config.DISABLE_JIT:
        problem = "numba compiles nothing, as NUMBA_DISABLE_JIT is set"
        return message(problem, consequence, "Unset it")
    return ""


def compiled(loop: _Loop) -> _Loop:
    """Return the ``loop``, a function of arrays and numbers, compiled at its first call with the
    arithmetic of NumPy: x/0 is no error.

    Compilation prints a line on stderr, see ``COMPILING``. If a compiled loop cannot be read from
    the cache, or cannot be kept there, the first such loop of a process issues a
    :class:`~granphon.base.errors.CacheWarning`. Without Numba the ``loop`` itself is called, in
    which x/0 is an error of Python's numbers, and a warning of NumPy's.
    """
    return cast("_Loop", CompiledLoop(loop))


class CompiledLoop:
    """A ``loop`` that Numba compiles when it is first called, or when another loop that calls it is
    compiled.
    """

    def __init__(self, loop: Callable[..., Any]) -> None:
        """Take name, module and docstring of the ``loop``, which is compiled later."""
        update_wrapper(self, loop)
        self._loop = loop

    def __call__(self, *arguments: Any) -> Any:
        """Return what the loop returns for these ``arguments``."""
        return self.dispatcher(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """The type by which Numba compiles the call of this loop in another one."""
        return self.dispatcher._numba_type_

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's object that compiles the loop for each signature, and calls it; the loop itself
        without Numba.
        """
        return self._loop if find_why_uncompiled() else _make_dispatcher(self._loop)


def _make_dispatcher(loop: Callable[..., Any]) -> Any:
    """Return Numba's object that compiles the ``loop``.

    The object holds back the signals that stop this process while a loop is compiled or read from
    the cache, announces the compilation, and warns where there can be no cache.
    """
    from numba import njit

    dispatcher: Any
    why_no_cache = ""
    try:
        dispatcher = njit(cache=True, **_NUMBA_OPTIONS)(loop)
        _survive_cache_errors(dispatcher._cache)
    except RuntimeError:  # Numba has found no folder for its cache
        dispatcher = njit(**_NUMBA_OPTIONS)(loop)
        why_no_cache = "There is no folder that can be written"
    compile_for = dispatcher.compile

    def compile_whole(signature: Any) -> Any:
        """Read the loop for one signature of argument types from the cache, or else compile it, as
        Numba does.

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
        """Compile the loop, which the cache does not hold, after a note that this takes long."""
        _announce_compilation()
        return compile_anew(arguments, returned)

    dispatcher._compiler.compile = announce_and_compile
    return dispatcher


def _survive_cache_errors(numba_cache: Any) -> None:
    """Replace the two methods by which Numba reads and writes its ``numba_cache``: instead of
    raising an error they issue a warning and clear the index, so that the loop is compiled anew.

    Before Numba reads its first loop, Numba makes all its functions known to its inference of
    types, which takes about as long as to read forty loops. A loop that is read has its types: the
    method that reads in place of Numba's own leaves this out. Numba does it before it compiles a
    loop.
    """

    def read(signature: Any, target: Any) -> Any:
        """Return the loop for a ``signature`` of argument types, with what it calls at run time in
        the ``target`` of compilation; None if the cache does not hold it.
        """
        target.load_additional_registries()
        return numba_cache._load_overload(signature, target)

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
                    os.unlink(numba_cache._cache_file._index_path)
                reason = str(error) or type(error).__name__
                _warn_of_cache(f"{numba_cache.cache_path}: {reason}")
                return None

        return access_or_warn

    numba_cache.load_overload = survive_errors_of(read)
    numba_cache.save_overload = survive_errors_of(numba_cache.save_overload)


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
    """Issue, once in a process, the warning that loops are compiled which a cache should hold, with
    the ``reason``, a sentence.
    """
    if not _issued_warnings:
        warning = message(
            "what numba has compiled cannot be read, or not be kept",
            reason,
            "It is compiled anew",
        )
        _issued_warnings.append(warning)
        warnings.warn(warning, CacheWarning, stacklevel=2)
