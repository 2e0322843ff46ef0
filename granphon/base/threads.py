"""Pieces of numerical work that do not depend on each other, on all processors that this process may use.

Other threads go on while numpy works on a large array. The libraries of linear algebra behind numpy start threads of their
own for each product, which wait for each other longer than a small product takes: meanwhile each is held to one.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def count_processors() -> int:
    """Return the number of processors that this process may use: one in a worker process, as others work beside it."""
    if multiprocessing.parent_process() is not None:
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share_out(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the results of a function for all items, in their order, found by as many threads as there are processors."""
    listed = list(items)
    threads = min(count_processors(), len(listed))
    if threads < 2:
        return [function(item) for item in listed]
    with ThreadPoolExecutor(threads) as executor:
        return list(executor.map(function, listed))


@contextmanager
def single_products() -> Iterator[None]:
    """Hold the libraries of linear algebra to one thread, in all threads of this process; not without threadpoolctl."""
    with ExitStack() as stack:
        with suppress(ImportError):
            from threadpoolctl import threadpool_limits

            stack.enter_context(threadpool_limits(1))
        yield
