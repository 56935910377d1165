# SPDX-License-Identifier: Apache-2.0
"""Threads over independent pieces of work.

Kernels release the interpreter lock, so plain threads use every core; numba's own
threading layers depend on import order and abort when two of them meet.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def cores() -> int:
    """Count the cores this process may use."""
    return len(os.sched_getaffinity(0))


def map_threads(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Apply `work` to each item on all cores.

    Args:
        work: Function of one item; it should spend its time in code that releases
            the interpreter lock.
        items: The pieces of work, independent of each other.

    Returns:
        The results in the order of the items, so that the outcome does not depend on
        the scheduling.
    """
    pieces = list(items)
    if len(pieces) < 2 or cores() < 2:
        return [work(piece) for piece in pieces]
    with ThreadPoolExecutor(min(cores(), len(pieces))) as pool:
        return list(pool.map(work, pieces))
