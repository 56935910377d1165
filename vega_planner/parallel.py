# SPDX-License-Identifier: Apache-2.0
"""Threads over independent pieces of work.

Kernels release the interpreter lock, so plain threads use every core; numba's own
threading layers depend on import order and abort when two of them meet.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import count
from typing import Any, TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

#: Marks the threads that work for others: work within their work stays with them.
_helping = threading.local()


def cores() -> int:
    """Count the cores this process may use."""
    return len(os.sched_getaffinity(0))


def map_threads(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Apply `work` to each item on all cores.

    The calling thread takes part; the others live as long as the process, since threads
    that come and go cost more than many a piece of work, and fresh memory each time.

    Args:
        work: Function of one item; it should spend its time in code that releases
            the interpreter lock. Within `work` a further call is serial.
        items: The pieces of work, independent of each other.

    Returns:
        The results in the order of the items, so that the outcome does not depend on
        the scheduling. What is raised is that of the first item that fails.
    """
    pieces = list(items)
    helpers = 0 if hasattr(_helping, "yes") else min(cores(), len(pieces)) - 1
    if helpers < 1:
        return [work(piece) for piece in pieces]
    results: list[Any] = [None] * len(pieces)
    failures: dict[int, BaseException] = {}
    taken = count()

    def run() -> None:
        while not failures and (index := next(taken)) < len(pieces):
            try:
                results[index] = work(pieces[index])
            except BaseException as error:
                failures[index] = error

    others = [_pool().submit(run) for _ in range(helpers)]
    _helping.yes = True
    try:
        run()
    finally:
        del _helping.yes
        wait(others)
    if failures:
        raise failures[min(failures)]
    return results


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), "map_threads", lambda: setattr(_helping, "yes", True))
